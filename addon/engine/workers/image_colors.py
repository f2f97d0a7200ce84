"""Images in colour spaces that only Blender knows, made scene-linear in a Blender of its own: there it may load what it
likes, and holds up no window. Called while a scene is read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...export.images import ConvertError, Encoded, as_rgba
from ...export.stop import Stop
from ...export.target import through_blender
from ...export.working_space import working_space
from .process import private_folder, run_to_end, telling_little_room

COMMAND = "convert-image"
JOB, PACKED, PIXELS, RESULT = "job.json", "packed", "pixels.npy", "result.npy"
MULTIPLIED = {"PREMUL"} if bpy.app.version >= (5, 0, 0) else {"PREMUL", "CHANNEL_PACKED"}
"""Alpha modes whose colours Cycles divides by alpha while it converts them; before 5.0 unrelated alpha too."""


def converted(image: Encoded, stop: Stop) -> np.ndarray:
    """Scene-linear RGBA [height, width, 4] of an image, bottom row first, multiplied by its alpha unless that is
    unrelated. Waits; raises `ExportCancelled` soon after `stop` says so, and ConvertError."""
    try:
        with private_folder() as folder:
            place = Path(folder)
            with telling_little_room(place):
                _write_job(place, image)
            _work(place, stop)
            return np.load(place / RESULT)
    except OSError as error:
        raise ConvertError(str(error)) from error


def _write_job(place: Path, image: Encoded) -> None:
    job = {"space": image.space, "alpha": image.alpha, "working_space": working_space(), "frame": image.frame}
    if image.pixels is not None:
        np.save(place / PIXELS, image.pixels)
    elif isinstance(image.file, bytes):
        (place / PACKED).write_bytes(image.file)
        job["file"] = str(place / PACKED)
    else:
        job["file"] = image.file
    (place / JOB).write_text(json.dumps(job), encoding="utf-8")


def _work(place: Path, stop: Stop) -> None:
    worker = run_to_end([COMMAND], place, stop)
    if worker.code != 0:
        raise ConvertError(worker.failure())


def convert(place: Path) -> None:
    """Body of `relume convert-image`, which runs in the other Blender: does the job of a folder."""
    job = json.loads((place / JOB).read_text(encoding="utf-8"))
    if job["working_space"] != working_space():
        bpy.ops.wm.set_working_color_space(working_space=job["working_space"])
    np.save(place / RESULT, _loaded(job) if "file" in job else _linear(np.load(place / PIXELS), job))


def _loaded(job: dict[str, Any]) -> np.ndarray:
    image = bpy.data.images.load(job["file"])
    image.colorspace_settings.name, image.alpha_mode = job["space"], job["alpha"]
    width, height = image.size
    if not width or not height:
        raise ConvertError("its file has no pixels")
    if job["frame"] is not None:
        image.scale(width, height, frame=job["frame"])  # Shows the frame, whose size it has.
    pixels = np.empty(width * height * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    rgba = as_rgba(pixels.reshape(height, width, image.channels))
    return rgba if image.is_float else _linear(rgba, job)


def _linear(encoded: np.ndarray, job: dict[str, Any]) -> np.ndarray:
    """Pixels of 8 bits, which Blender keeps as they are in their file, as scene-linear ones."""
    alpha = encoded[..., 3:]
    is_multiplied = job["alpha"] in MULTIPLIED
    colors = encoded[..., :3] / np.where(alpha > 0.0, alpha, 1.0) if is_multiplied else encoded[..., :3]
    linear = through_blender(colors, job["space"])
    linear = linear * alpha if is_multiplied or job["alpha"] == "STRAIGHT" else linear
    return np.concatenate([linear, alpha], axis=2)
