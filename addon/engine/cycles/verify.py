"""Verify: Cycles renders the present state of a shot in a Blender of its own, and the difference is told."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np

from ..workers.process import SavedCopy, Worker, blender_command, telling_little_room
from .reference import DIFFERENCE, JOB, PICTURE, REFERENCE, RESULT

SUMMARY = json.dumps({"samples": 0, "makers": {}, "denoised": False})


class VerifyError(Exception):
    """Verifying cannot be started or has failed; the message says why."""


@dataclass(frozen=True, eq=False)
class ImageFrame:
    """Picture with the fields of a native frame, so that it can be shown and compared as one."""

    image: np.ndarray
    serial: int = 0
    request: int = 0
    scale: int = 1
    summary: str = SUMMARY


class Verification:
    """One comparison: running, failed, or with its pictures and figures."""

    def __init__(self, scene: bpy.types.Scene, frame: Any, camera: str, samples: int, mix: dict[str, Any]):
        if frame is None or frame.scale != 1:
            raise VerifyError("wait for the picture in full size, then verify it")
        if scene.objects.get(camera) is None:
            raise VerifyError(f"camera '{camera}' of the bake is not in the scene")
        self.scene_uid = scene.session_uid
        self.ours = ImageFrame(np.array(frame.image, np.float32))
        self.stage: dict[str, Any] = {"done": 0, "total": 1, "remaining_s": None}
        self.error = ""
        self.result: dict[str, Any] | None = None
        self.reference: ImageFrame | None = None
        self.difference: ImageFrame | None = None
        self._copy = SavedCopy(scene)
        try:
            folder = self._copy.folder
            job = {"scene": scene.name, "camera": camera, "samples": samples, "mix": mix, "devices": _devices(scene)}
            with telling_little_room(folder):
                np.save(folder / PICTURE, self.ours.image)
                (folder / JOB).write_text(json.dumps(job), encoding="utf-8")
            command = blender_command(self._copy.blend, ["verify", str(folder), "--json"])
            self._worker: Worker | None = Worker(command, folder)
        except BaseException:
            self._copy.remove()
            raise

    @property
    def is_running(self) -> bool:
        """True while Cycles is at work."""
        return self._worker is not None

    def poll(self) -> bool:
        """Takes the output of the other Blender; returns True if there was any."""
        worker = self._worker
        if worker is None:
            return False
        ended, events = worker.ended, worker.events()
        for event in events:
            if event.get("event") == "progress":
                self.stage = event
        if ended:
            self._finish(worker)
        return ended or bool(events)

    def _finish(self, worker: Worker) -> None:
        folder = self._copy.folder
        try:
            if worker.code == 0:
                self.result = json.loads((folder / RESULT).read_text(encoding="utf-8"))
                self.reference = ImageFrame(np.load(folder / REFERENCE))
                self.difference = ImageFrame(np.load(folder / DIFFERENCE))
            else:
                self.error = worker.failure()
        except (OSError, ValueError) as error:
            self.error = str(error)
        self._worker = None
        self._copy.remove()

    def cancel(self) -> None:
        """Ends it; nothing stays."""
        if self._worker is not None:
            self._worker.end(self._copy.remove)
            self._worker = None
            self.error = "cancelled"


def _devices(scene: bpy.types.Scene) -> dict[str, Any] | None:
    """The graphics cards that Cycles may use."""
    addon = bpy.context.preferences.addons.get("cycles")
    if addon is None or scene.cycles.device != "GPU":
        return None
    preferences = addon.preferences
    return {
        "type": preferences.compute_device_type,
        "ids": [device.id for device in preferences.devices if device.use],
    }


_verifications: dict[int, Verification] = {}


def start(scene: bpy.types.Scene, frame: Any, camera: str, samples: int, mix: dict[str, Any]) -> Verification:
    """Starts a comparison of the newest frame; one that runs for this scene is ended."""
    close(scene.session_uid)
    verification = _verifications[scene.session_uid] = Verification(scene, frame, camera, samples, mix)
    return verification


def of(scene: bpy.types.Scene) -> Verification | None:
    """The newest comparison of a scene."""
    return _verifications.get(scene.session_uid)


def all_running() -> list[Verification]:
    """All comparisons that run."""
    return [verification for verification in _verifications.values() if verification.is_running]


def close(scene_uid: int) -> None:
    """Ends and forgets the comparison of a scene."""
    verification = _verifications.pop(scene_uid, None)
    if verification is not None:
        verification.cancel()


def close_gone() -> None:
    """Ends and forgets the comparisons of scenes that were deleted."""
    for uid in _verifications.keys() - {scene.session_uid for scene in bpy.data.scenes}:
        close(uid)


def close_all() -> None:
    """Ends and forgets all."""
    for uid in list(_verifications):
        close(uid)
