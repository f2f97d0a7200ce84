"""Renders by Cycles that our own jobs compute with: plain means of all samples, scene-linear, in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np


def set_up(scene: bpy.types.Scene, size: tuple[int, int], render: dict[str, Any], cycles: dict[str, Any]) -> None:
    """Sets up a scene for a render by Cycles of this size, with all samples in each pixel, into an EXR file of 32 bits.
    `render` and `cycles` are further settings; those that this Blender does not have are left out."""
    owner = scene.render
    size_settings = {"resolution_x": size[0], "resolution_y": size[1], "resolution_percentage": 100}
    _set(owner, {"engine": "CYCLES", **size_settings, **render})
    _set(scene.cycles, {"use_adaptive_sampling": False, "use_denoising": False, "time_limit": 0.0, **cycles})
    # Which formats there are depends on the type of media.
    _set(owner.image_settings, {"media_type": "IMAGE"})
    _set(owner.image_settings, {"file_format": "OPEN_EXR", "color_mode": "RGBA", "color_depth": "32"})


def _set(owner: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        if hasattr(owner, name):
            setattr(owner, name, value)


def read_picture(path: Path) -> np.ndarray:
    """RGBA [height, width, 4], bottom row first."""
    image = bpy.data.images.load(str(path))
    try:
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        return values.reshape(image.size[1], image.size[0], -1)
    finally:
        bpy.data.images.remove(image)
