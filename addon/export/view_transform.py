"""The scene's view transform as a table that needs no Blender afterwards.

Blender itself colours an image of log-spaced scene-linear values, so view, look, exposure, gamma, curves and white
balance are all in it. Layout and spacing are those of `relume_image::ViewTransform`.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np

SIZE = 65
SHAPER_MIN, SHAPER_MAX, SHAPER_OFFSET = -12.0, 7.0, 2.0**-12
PNG_END = b"IEND\xae\x42\x60\x82"


def is_srgb_curve(scene: bpy.types.Scene) -> bool:
    """Whether the view is the sRGB curve after exposure and before gamma, for which the formula is exact."""
    view = scene.view_settings
    plain = view.view_transform == "Standard" and view.look == "None" and not view.use_curve_mapping
    linear = getattr(getattr(bpy.data, "colorspace", None), "working_space", "Linear Rec.709")
    balanced = not getattr(view, "use_white_balance", False)
    return plain and balanced and linear == "Linear Rec.709" and scene.display_settings.display_device == "sRGB"


def is_standard(scene: bpy.types.Scene) -> bool:
    """Whether the view is the plain sRGB curve, so that no table is needed."""
    view = scene.view_settings
    return is_srgb_curve(scene) and view.exposure == 0.0 and view.gamma == 1.0


def shaper_axis(size: int, log_max: float = SHAPER_MAX) -> np.ndarray:
    """Scene-linear values of the entries along each axis of a table, [size]; the last one is about `2^log_max`."""
    steps = np.linspace(SHAPER_MIN, log_max, size, dtype=np.float64)
    return np.maximum(np.exp2(steps) - SHAPER_OFFSET, 0.0).astype(np.float32)


def write_view_table(scene: bpy.types.Scene, path: Path) -> None:
    """Writes the table as a 16-bit PNG of SIZE^2 by SIZE pixels, whole or not at all."""
    axis = shaper_axis(SIZE)
    pixels = np.empty((SIZE, SIZE, SIZE, 3), np.float32)  # [green from the top, blue, red, channel]
    pixels[..., 0], pixels[..., 1], pixels[..., 2] = axis, axis[:, None, None], axis[:, None]
    part = path.with_name(f".part-{path.name}")
    try:
        _write_displayed(scene, pixels.reshape(SIZE, -1, 3)[::-1], part)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def displayed(scene: bpy.types.Scene, colors: np.ndarray) -> np.ndarray:
    """Display colours as Blender makes them of opaque scene-linear ones, in 16 bits; both [height, width, 3]."""
    handle, name = tempfile.mkstemp(suffix=".png", dir=bpy.app.tempdir or None)
    os.close(handle)
    try:
        _write_displayed(scene, colors, Path(name))
        image = bpy.data.images.load(name)
        try:
            image.colorspace_settings.name = "Non-Color"
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            bpy.data.images.remove(image)
    finally:
        Path(name).unlink()
    return pixels.reshape(*colors.shape[:2], -1)[..., :3]


def _write_displayed(scene: bpy.types.Scene, colors: np.ndarray, path: Path) -> None:
    """Writes scene-linear colours, [height from the bottom, width, 3], as a 16-bit PNG of the scene's view."""
    height, width = colors.shape[:2]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = colors
    image = bpy.data.images.new("relume view table", width, height, float_buffer=True)
    try:
        image.pixels.foreach_set(pixels.reshape(-1))
        with _png_settings(scene):
            image.save_render(str(path), scene=scene)
    finally:
        bpy.data.images.remove(image)
    # Blender reports success on a full disk.
    if not path.read_bytes().endswith(PNG_END):
        raise OSError(f"cannot write the view transform; check the free space: {path}")


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
