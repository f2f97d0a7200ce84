"""Jobs of a shot in a Blender of their own, such as its bake: they go on while the artist works, and while other files
are open. What one has written stays when it is stopped, and the next start goes on from there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ...core import bake_goal
from ..workers.process import SavedCopy, Worker, blender_command
from . import shot
from .options import Options, options_of

LIGHTS_FILE = "lights.json"
KINDS = {"sphere": "sphere", "facing_disk": "facing-disk", "quad": "quad"}
"""Proxies that can be trained, by the shape of a light."""
MIB = 2**20
STOPPED = "stopped; start it again to go on"


class BackgroundError(Exception):
    """The background bake cannot be started; the message says why."""


class BackgroundJob:
    """Commands that other Blenders run one after the other for a scene."""

    def __init__(self, scene: bpy.types.Scene, folder: Path, steps: list[list[str]], is_of_file: bool):
        """`steps` are the words of each command that writes into `folder`. The first one reads the open file as it is
        now, if `is_of_file`."""
        self.scene_uid, self.name = scene.session_uid, scene.name
        self.camera = scene.camera.name if scene.camera else ""
        self.folder = folder
        self.stage: dict[str, Any] = {"stage": "prepare", "done": 0, "total": 1, "remaining_s": None, "message": ""}
        self.warnings: list[str] = []
        self.result: dict[str, Any] = {}
        """Result of the last command."""
        self.error = ""
        self.done = False
        self._stopped = False
        self._copy: SavedCopy | None = SavedCopy(scene) if is_of_file else None
        self._steps = steps
        try:
            self._start_next()
        except OSError:
            self._remove_copy()
            raise

    @property
    def is_running(self) -> bool:
        """True until the job has ended."""
        return not (self.done or self.error)

    @property
    def bake(self) -> Path | None:
        """Bake folder that it has made, if the scene is to show one."""
        return None

    @property
    def done_words(self) -> str:
        """Message for the artist once it has ended well."""
        return ""

    def poll(self) -> bool:
        """Takes the output of the other Blender; returns True if there was any."""
        if not self.is_running:
            return False
        ended, events = self._worker.ended, self._worker.events()
        for event in events:
            self._take(event)
        if ended:
            self._next_step()
        return ended or bool(events)

    def _take(self, event: dict[str, Any]) -> None:
        kind = event.get("event")
        if kind == "progress":
            self.stage = event
        elif kind == "warning":
            self.warnings.append(event["message"])
        elif kind == "result":
            self.result = event

    def _next_step(self) -> None:
        if self._worker.code != 0:
            self.error = STOPPED if self._stopped else self._worker.failure()
        else:
            try:
                self._go_on()
            except (OSError, ValueError, KeyError) as error:
                self.error = f"it could not go on: {error}"
        if not self.is_running:
            self._remove_copy()

    def _go_on(self) -> None:
        """Starts what follows a step that went well; there may be nothing."""
        if self._steps:
            self._start_next()
        else:
            self.done = True

    def _start_next(self) -> None:
        arguments = self._steps.pop(0)
        command = blender_command(self._copy.blend if self._copy else None, arguments)
        self._worker = Worker(command, self.folder)

    def cancel(self) -> None:
        """Asks the other Blender to end; what is there stays."""
        self._stopped = True
        self._steps.clear()
        self._worker.stop()

    def close(self) -> None:
        """Ends it at once. Files are whole at every moment."""
        self._stopped = True
        self._worker.kill()
        self._worker.events()
        self.error = self.error or STOPPED
        self._remove_copy()

    def _remove_copy(self) -> None:
        if self._copy is not None:
            self._copy.remove()
            self._copy = None


class BackgroundBake(BackgroundJob):
    """A bake: tracing first, then a training for each type of light."""

    def __init__(self, scene: bpy.types.Scene):
        found = shot.of(scene)
        if found is not None and found.is_working:
            raise BackgroundError("this shot is being traced already; cancel that first")
        self.options: Options = options_of(scene)
        super().__init__(scene, self.options.folder, [self._bake_arguments(scene)], is_of_file=True)

    @property
    def bake(self) -> Path | None:
        """The bake folder."""
        return self.folder

    @property
    def done_words(self) -> str:
        """Where the bake is."""
        return f"The background bake is ready in '{self.folder}'"

    def _go_on(self) -> None:
        if self._copy is not None:  # It was the bake.
            self._remove_copy()
            self._steps += [self._train_arguments(kind) for kind in self._kinds()]
            bake_goal.BakeGoal(self.options.samples, self.options.train_seconds).write(self.folder)
        if not self._steps:
            bake_goal.forget(self.folder)
        super()._go_on()

    def _bake_arguments(self, scene: bpy.types.Scene) -> list[str]:
        options = self.options
        command = ["bake", "--out", str(options.folder), "--scene", scene.name, "--camera", scene.camera.name]
        return [
            *command,
            "--samples",
            str(options.samples),
            "--resume",
            "--replace",
            "--json",
            "--threads",
            str(options.threads),
        ]

    def _train_arguments(self, kind: str) -> list[str]:
        options = self.options
        command = ["train", str(options.folder), "--type", kind, "--seconds", str(options.train_seconds), "--resume"]
        memory = ["--gpu-memory", str(options.gpu_memory // MIB)] if options.gpu_memory else []
        return [*command, "--json", "--threads", str(options.threads), "--device", options.device, *memory]

    def _kinds(self) -> list[str]:
        """Types of light that the baked scene has."""
        if self.options.train_seconds <= 0.0:
            return []
        lights = json.loads((self.folder / LIGHTS_FILE).read_text(encoding="utf-8"))["lights"]
        shapes = {light["shape"]["type"] for light in lights}
        return [kind for shape, kind in KINDS.items() if shape in shapes]


_jobs: list[BackgroundJob] = []


def start(scene: bpy.types.Scene, kind: Callable[[bpy.types.Scene], BackgroundJob] = BackgroundBake) -> BackgroundJob:
    """Starts a job for a scene that can be baked (`checks.check_start`). It replaces the scene's last one, if that has
    ended."""
    forget(scene)
    job = kind(scene)
    _jobs.append(job)
    return job


def of(scene: bpy.types.Scene) -> BackgroundJob | None:
    """The job of a scene."""
    return next((job for job in _jobs if job.scene_uid == scene.session_uid), None)


def all_jobs() -> list[BackgroundJob]:
    """All jobs, also those of files that are not open any more."""
    return list(_jobs)


def forget(scene: bpy.types.Scene) -> None:
    """Forgets a scene's job that has ended."""
    _jobs[:] = [job for job in _jobs if job.is_running or job.scene_uid != scene.session_uid]


def close_all() -> None:
    """Ends and forgets all jobs."""
    for job in _jobs:
        if job.is_running:
            job.close()
    _jobs.clear()
