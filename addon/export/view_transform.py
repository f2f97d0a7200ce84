"""The scene's view transform as a table that needs no Blender afterwards.

Blender itself colours an image of log-spaced scene-linear values, so view, look, exposure, gamma, curves and white
balance are all in it. Layout and spacing are those of `relume_image::ViewTransform`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np

SIZE = 65
SHAPER_MIN, SHAPER_MAX, SHAPER_OFFSET = -12.0, 7.0, 2.0**-12
PNG_END = b"IEND\xae\x42\x60\x82"


def is_standard(scene: bpy.types.Scene) -> bool:
    """Whether the view is the plain sRGB curve, for which the formula is exact and no table is needed."""
    view = scene.view_settings
    plain = view.view_transform == "Standard" and view.look == "None" and not view.use_curve_mapping
    neutral = view.exposure == 0.0 and view.gamma == 1.0 and not getattr(view, "use_white_balance", False)
    return plain and neutral and scene.display_settings.display_device == "sRGB"


def write_view_table(scene: bpy.types.Scene, path: Path) -> None:
    """Writes the table as a 16-bit PNG of SIZE^2 by SIZE pixels, whole or not at all."""
    steps = np.linspace(SHAPER_MIN, SHAPER_MAX, SIZE, dtype=np.float64)
    axis = np.maximum(np.exp2(steps) - SHAPER_OFFSET, 0.0).astype(np.float32)
    pixels = np.ones((SIZE, SIZE, SIZE, 4), np.float32)  # [green from the top, blue, red, channel]
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = axis, axis[:, None, None], axis[:, None]
    part = path.with_name(f".part-{path.name}")
    image = bpy.data.images.new("relume view table", SIZE * SIZE, SIZE, float_buffer=True)
    try:
        image.pixels.foreach_set(np.ascontiguousarray(pixels[::-1]).reshape(-1))
        with _png_settings(scene):
            image.save_render(str(part), scene=scene)
        # Blender reports success on a full disk.
        if not part.read_bytes().endswith(PNG_END):
            raise OSError(f"cannot write the view transform; check the free space: {path}")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
        bpy.data.images.remove(image)


@contextmanager
def _png_settings(scene: bpy.types.Scene) -> Iterator[None]:
    """Sixteen bits, no dithering, coloured by the scene; all settings put back afterwards."""
    output = scene.render.image_settings
    wanted: list[tuple[Any, str, Any]] = [
        (output, "media_type", "IMAGE"),
        (output, "file_format", "PNG"),
        (output, "color_mode", "RGB"),
        (output, "color_depth", "16"),
        (output, "compression", 15),
        (output, "color_management", "FOLLOW_SCENE"),
        (scene.render, "dither_intensity", 0.0),
    ]
    wanted = [(owner, name, value) for owner, name, value in wanted if hasattr(owner, name)]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in wanted]
    try:
        for owner, name, value in wanted:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
