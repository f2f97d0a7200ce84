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


def verify(folder: Path, on_progress: Callable[[int, int], None]) -> dict[str, Any]:
    """Renders and compares as `job.json` says. Leaves Cycles' picture and the difference, [height, width, 4], bottom
    row first, in the folder and returns the figures."""
    job = json.loads((folder / JOB).read_text(encoding="utf-8"))
    picture = np.load(folder / PICTURE)
    scene = bpy.data.scenes[job["scene"]]
    height, width = picture.shape[:2]
    _prepare(scene, job, (width, height))
    write_mix(scene, job["mix"])
    halves = _render_halves(scene, job["samples"], folder / "part.exr", on_progress)
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
    }
    (folder / RESULT).write_text(json.dumps(result), encoding="utf-8")
    return result


def _prepare(scene: bpy.types.Scene, job: dict[str, Any], size: tuple[int, int]) -> None:
    scene.camera = scene.objects[job["camera"]]
    # Only seed and samples change between the parts.
    whole = {"use_border": False, "use_multiview": False, "use_persistent_data": True}
    set_up(scene, size, whole | WITHOUT_EFFECTS, {"use_animated_seed": False})
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


def _render_halves(
    scene: bpy.types.Scene, samples: int, path: Path, on_progress: Callable[[int, int], None]
) -> list[np.ndarray]:
    """Means of the even and of the odd parts."""
    parts = min(PARTS, max(samples // 2 * 2, 2))
    sums: list[Any] = [0.0, 0.0]
    weights = [0, 0]
    for part in range(parts):
        on_progress(part, parts)
        count = max((part + 1) * samples // parts - part * samples // parts, 1)
        scene.cycles.samples, scene.cycles.seed = count, part
        scene.render.filepath = str(path)
        bpy.ops.render.render(write_still=True, scene=scene.name)
        sums[part % 2] = sums[part % 2] + count * read_picture(path)
        weights[part % 2] += count
    on_progress(parts, parts)
    path.unlink()
    return [total / weight for total, weight in zip(sums, weights, strict=True)]


def _opaque(image: np.ndarray) -> np.ndarray:
    return np.concatenate([image, np.ones_like(image[..., :1])], axis=-1)
