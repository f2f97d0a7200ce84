"""The scene's view transform as a table that needs no Blender afterwards.

Blender itself colours an image of log-spaced scene-linear values, so view, look, exposure, gamma, curves and white
balance are all in it. Layout and spacing are those of `relume_image::ViewTransform`.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .working_space import LINEAR_REC709, working_space

SHAPER_MIN, SHAPER_MAX, SHAPER_OFFSET = -12.0, 7.0, 2.0**-12
PNG_END = b"IEND\xae\x42\x60\x82"
HIDDEN_NAME = ".relume view"
"""Name of images that exist for a moment: lists leave out names that begin with a dot."""
FIRST = ("display_device", "use_curve_mapping", "view_transform", "look")
"""Settings that others depend on, in the order in which they are set."""


def is_srgb_view(scene: bpy.types.Scene) -> bool:
    """True if the view is the sRGB curve of Linear Rec.709, after exposure and before gamma, so that a formula is
    exact."""
    view = scene.view_settings
    plain = view.view_transform == "Standard" and view.look == "None" and not view.use_curve_mapping
    balanced = not getattr(view, "use_white_balance", False)
    return plain and balanced and scene.display_settings.display_device == "sRGB"


def is_srgb_curve(scene: bpy.types.Scene) -> bool:
    """True if the view is the sRGB curve of the file's scene-linear values themselves."""
    return is_srgb_view(scene) and working_space() == LINEAR_REC709


def is_standard(scene: bpy.types.Scene) -> bool:
    """True if the view is the plain sRGB curve, so that no table is needed."""
    view = scene.view_settings
    return is_srgb_curve(scene) and view.exposure == 0.0 and view.gamma == 1.0


def view_settings(scene: bpy.types.Scene, with_exposure: bool = True) -> dict[str, Any]:
    """All that the view of a scene depends on, as JSON has it, for `set_view` in another Blender; with or without
    exposure."""
    view = scene.view_settings
    settings: dict[str, Any] = {
        "working_space": working_space(),
        "display": _plain(scene.display_settings),
        "view": _plain(view),
        "curves": None,
    }
    if not with_exposure:
        settings["view"]["exposure"] = 0.0
    if view.use_curve_mapping:
        mapping = view.curve_mapping
        points = [[[*point.location, point.handle_type] for point in curve.points] for curve in mapping.curves]
        levels = {name: list(getattr(mapping, name)) for name in ("black_level", "white_level")}
        settings["curves"] = {"settings": _plain(mapping) | levels, "points": points}
    return settings


def view_key(scene: bpy.types.Scene, with_exposure: bool = True) -> str:
    """Text of the view settings that differs between any two views."""
    return json.dumps(view_settings(scene, with_exposure), sort_keys=True)


def _plain(owner: bpy.types.bpy_struct) -> dict[str, Any]:
    """Properties that are numbers or words; others follow from these."""
    values = {name: getattr(owner, name) for name in owner.bl_rna.properties.keys()}
    return {name: value for name, value in values.items() if isinstance(value, bool | int | float | str)}


def set_view(scene: bpy.types.Scene, settings: dict[str, Any]) -> None:
    """Gives a scene the view of another one (`view_settings`), and the file its working space."""
    space = settings["working_space"]
    if working_space() != space:
        bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=False)
    _set(scene.display_settings, settings["display"])
    _set(scene.view_settings, settings["view"])
    if settings["curves"] is not None:
        _set_curves(scene.view_settings.curve_mapping, settings["curves"])


def _set(owner: bpy.types.bpy_struct, values: dict[str, Any]) -> None:
    for name in sorted(values, key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST)):
        if not owner.is_property_readonly(name):
            setattr(owner, name, values[name])


def _set_curves(mapping: bpy.types.CurveMapping, curves: dict[str, Any]) -> None:
    _set(mapping, curves["settings"])
    for curve, points in zip(mapping.curves, curves["points"], strict=True):
        while len(curve.points) < len(points):
            curve.points.new(0.0, 0.0)
        while len(curve.points) > len(points):
            curve.points.remove(curve.points[-1])
        for point, (x, y, handle) in zip(curve.points, points, strict=True):
            point.location, point.handle_type = (x, y), handle
    mapping.update()


def shaper_axis(size: int, log_max: float = SHAPER_MAX) -> np.ndarray:
    """Scene-linear values of the entries along each axis of a table, [size]; the last one is about `2^log_max`."""
    steps = np.linspace(SHAPER_MIN, log_max, size, dtype=np.float64)
    return np.maximum(np.exp2(steps) - SHAPER_OFFSET, 0.0).astype(np.float32)


def displayed(scene: bpy.types.Scene, colors: np.ndarray, view: dict[str, Any] | None = None) -> np.ndarray:
    """Display colours as Blender makes them of opaque scene-linear ones, in 16 bits; both [height, width, 3]. With
    `view` in another view than the scene's: its `display_device` and properties of view settings."""
    handle, name = tempfile.mkstemp(suffix=".png", dir=bpy.app.tempdir or None)
    os.close(handle)
    path = Path(name)
    try:
        _write(scene, colors, view, path)
        return _read(path).reshape(*colors.shape[:2], -1)[..., :3]
    finally:
        path.unlink(missing_ok=True)


def _write(scene: bpy.types.Scene, colors: np.ndarray, view: dict[str, Any] | None, path: Path) -> None:
    """Writes scene-linear colours, [height from the bottom, width, 3], as a 16-bit PNG of a view."""
    height, width = colors.shape[:2]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = colors
    image = bpy.data.images.new(HIDDEN_NAME, width, height, float_buffer=True)
    try:
        image.pixels.foreach_set(pixels.reshape(-1))
        with _png_settings(scene, view):
            image.save_render(str(path), scene=scene)
    finally:
        bpy.data.images.remove(image)
    # Blender reports success on a full disk.
    if not path.read_bytes().endswith(PNG_END):
        raise OSError(f"cannot write the view transform; check the free space: {path}")


def _read(path: Path) -> np.ndarray:
    image = bpy.data.images.load(str(path))
    try:
        image.name = HIDDEN_NAME
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        return pixels
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _png_settings(scene: bpy.types.Scene, view: dict[str, Any] | None) -> Iterator[None]:
    """Sixteen bits, no dithering, coloured by the scene or a view of its own; all settings put back afterwards."""
    output = scene.render.image_settings
    settings: list[tuple[Any, str, Any]] = [
        (output, "media_type", "IMAGE"),
        (output, "file_format", "PNG"),
        (output, "color_mode", "RGB"),
        (output, "color_depth", "16"),
        (output, "compression", 15),
        (output, "color_management", "OVERRIDE" if view else "FOLLOW_SCENE"),
        (scene.render, "dither_intensity", 0.0),
    ]
    for name, value in (view or {}).items():
        settings.append((output.display_settings if name == "display_device" else output.view_settings, name, value))
    settings = [(owner, name, value) for owner, name, value in settings if hasattr(owner, name)]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in settings]
    try:
        for owner, name, value in settings:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
