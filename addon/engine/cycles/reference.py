"""The body of `relume verify`: Cycles renders the open file in a few parts of different noise, and the mean is compared
with a picture of Relume. Runs in a Blender of its own, on a copy of the file."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core import metrics
from ...export.left_out import WITHOUT_EFFECTS
from .mix import write_mix
from .render import read_picture, set_up

JOB, PICTURE, RESULT = "job.json", "picture.npy", "result.json"
REFERENCE, DIFFERENCE = "cycles.npy", "difference.npy"
PARTS = 8
"""Renders that the samples are spread over: steps of progress, and two halves that tell the noise."""
CLAMPS = ("sample_clamp_direct", "sample_clamp_indirect")


def verify(folder: Path, on_progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Renders and compares as `job.json` says. Leaves Cycles' picture and the difference, [height, width, 4], bottom
    row first, in the folder and returns the figures."""
    job = json.loads((folder / JOB).read_text(encoding="utf-8"))
    picture = np.load(folder / PICTURE)
    scene = bpy.data.scenes[job["scene"]]
    height, width = picture.shape[:2]
    clamps = {name: getattr(scene.cycles, name) for name in CLAMPS}
    _prepare(scene, job, (width, height))
    write_mix(scene, job["mix"])
    parts = _Parts(scene, job["samples"], folder / "part.exr", any(clamps.values()), on_progress)
    halves = parts.halves()
    reference = (halves[0] + halves[1]) / 2.0
    ours, cycles = picture[..., :3], reference[..., :3]
    np.save(folder / REFERENCE, reference)
    np.save(folder / DIFFERENCE, _opaque(metrics.false_color(ours, cycles)))
    result = {
        "error": metrics.relative_error(ours, cycles),
        "psnr": metrics.psnr_reinhard(ours, cycles),
        # The mean of two halves is off by about half of their difference.
        "noise": metrics.relative_error(halves[0][..., :3], halves[1][..., :3]) / 2.0,
        "samples": job["samples"],
        "clamped": parts.light_lost_to(clamps),
    }
    (folder / RESULT).write_text(json.dumps(result), encoding="utf-8")
    return result


def _prepare(scene: bpy.types.Scene, job: dict[str, Any], size: tuple[int, int]) -> None:
    scene.camera = scene.objects[job["camera"]]
    # Only seed and samples change between the parts.
    whole = {"use_border": False, "use_multiview": False, "use_persistent_data": True}
    set_up(scene, size, whole | WITHOUT_EFFECTS, {"use_animated_seed": False} | dict.fromkeys(CLAMPS, 0.0))
    _use_devices(job.get("devices"))


def _use_devices(devices: dict[str, Any] | None) -> None:
    """The user's choice, as factory settings know none. A device that is gone leaves the processor."""
    if not devices:
        return
    preferences = bpy.context.preferences.addons["cycles"].preferences
    with suppress(TypeError):
        preferences.compute_device_type = devices["type"]
        preferences.get_devices_for_type(devices["type"])
        for device in preferences.devices:
            device.use = device.id in devices["ids"]


class _Parts:
    """Renders of different noise, without clamping of samples, which paths without lights cannot follow."""

    def __init__(
        self, scene: bpy.types.Scene, samples: int, path: Path, clamps: bool, on_progress: Callable[[int, int], None]
    ):
        """If the file `clamps`, one more render is to tell what that changes."""
        self.scene, self.path, self.on_progress = scene, path, on_progress
        parts = min(PARTS, max(samples // 2 * 2, 2))
        ends = [part * samples // parts for part in range(parts + 1)]
        self.counts = [max(end - start, 1) for start, end in zip(ends, ends[1:], strict=False)]
        self.total = parts + clamps
        self.first: Any = None

    def halves(self) -> list[np.ndarray]:
        """Means of the even and of the odd parts."""
        sums: list[Any] = [0.0, 0.0]
        for part, count in enumerate(self.counts):
            self.on_progress(part, self.total)
            picture = self._render(part)
            self.first = picture if part == 0 else self.first
            sums[part % 2] = sums[part % 2] + count * picture
        self.on_progress(len(self.counts), self.total)
        return [total / sum(self.counts[half::2]) for half, total in enumerate(sums)]

    def light_lost_to(self, clamps: dict[str, float]) -> float:
        """Share of the light that the file's clamping takes, by the same samples with and without."""
        if not any(clamps.values()):
            return 0.0
        for name, value in clamps.items():
            setattr(self.scene.cycles, name, value)
        clamped = self._render(0)
        self.on_progress(self.total, self.total)
        return 1.0 - float(clamped[..., :3].mean()) / max(float(self.first[..., :3].mean()), 1e-9)

    def _render(self, part: int) -> np.ndarray:
        self.scene.cycles.samples, self.scene.cycles.seed = self.counts[part], part
        self.scene.render.filepath = str(self.path)
        bpy.ops.render.render(write_still=True, scene=self.scene.name)
        picture = read_picture(self.path)
        self.path.unlink()
        return picture


def _opaque(image: np.ndarray) -> np.ndarray:
    return np.concatenate([image, np.ones_like(image[..., :1])], axis=-1)
