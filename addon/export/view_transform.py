"""The scene's view transform as a table that needs no Blender afterwards.

Blender itself colours an image of log-spaced scene-linear values, so view, look, exposure, gamma, curves and white
balance are all in it. Layout and spacing are those of `relume_image::ViewTransform`.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .working_space import LINEAR_REC709, working_space

SHAPER_MIN, SHAPER_MAX, SHAPER_OFFSET = -12.0, 7.0, 2.0**-12
PNG_END = b"IEND\xae\x42\x60\x82"
SLICE_SECONDS = 0.012
"""How long Blender may colour at once while an artist is at work."""
FEWEST_ENTRIES, MOST_ENTRIES = 8_000, 100_000
"""Of a slice: fewer do not become quicker, for a file is written and read each time."""

WITHOUT_FILES = "Raw"
"""A view of Blender's own colour configuration that needs no other file."""

HIDDEN_NAME = ".relume view"
"""Of images that exist for a moment: lists leave out what begins with a dot."""

_entries = FEWEST_ENTRIES
"""How many colours SLICE_SECONDS are enough for, by the slice before."""


def is_srgb_view(scene: bpy.types.Scene) -> bool:
    """Whether the view is the sRGB curve of Linear Rec.709, after exposure and before gamma: a formula is exact."""
    view = scene.view_settings
    plain = view.view_transform == "Standard" and view.look == "None" and not view.use_curve_mapping
    balanced = not getattr(view, "use_white_balance", False)
    return plain and balanced and scene.display_settings.display_device == "sRGB"


def is_srgb_curve(scene: bpy.types.Scene) -> bool:
    """Whether the view is the sRGB curve of the file's scene-linear values themselves."""
    return is_srgb_view(scene) and working_space() == LINEAR_REC709


def is_standard(scene: bpy.types.Scene) -> bool:
    """Whether the view is the plain sRGB curve, so that no table is needed."""
    view = scene.view_settings
    return is_srgb_curve(scene) and view.exposure == 0.0 and view.gamma == 1.0


def view_key(scene: bpy.types.Scene, with_exposure: bool = True) -> tuple:
    """All that the view of a scene depends on, as plain values."""
    view = scene.view_settings
    apart = {"curve_mapping"} if with_exposure else {"curve_mapping", "exposure"}
    key = [working_space()]
    key += _values(view, apart) + _values(scene.display_settings, set())
    if view.use_curve_mapping:
        key += _curves(view.curve_mapping)
    return tuple(key)


def _values(owner: bpy.types.bpy_struct, apart: set[str]) -> list[Any]:
    found = []
    for name in owner.bl_rna.properties.keys():
        if name not in apart | {"rna_type"}:
            value = getattr(owner, name)
            found.append((name, value if isinstance(value, bool | int | float | str) else tuple(value)))
    return found


def _curves(mapping: bpy.types.CurveMapping) -> list[Any]:
    points = [
        (curve_index, *point.location, point.handle_type)
        for curve_index, curve in enumerate(mapping.curves)
        for point in curve.points
    ]
    return _values(mapping, {"curves"}) + points


def shaper_axis(size: int, log_max: float = SHAPER_MAX) -> np.ndarray:
    """Scene-linear values of the entries along each axis of a table, [size]; the last one is about `2^log_max`."""
    steps = np.linspace(SHAPER_MIN, log_max, size, dtype=np.float64)
    return np.maximum(np.exp2(steps) - SHAPER_OFFSET, 0.0).astype(np.float32)


def displayed_in_slices(
    scene: bpy.types.Scene,
    height: int,
    width: int,
    colors_of: Callable[[slice], np.ndarray],
    view: dict[str, Any] | None = None,
) -> Iterator[tuple[slice, np.ndarray]]:
    """Rows with their display colours, as many at a time as Blender colours in SLICE_SECONDS. `colors_of` gives
    scene-linear colours of rows, [rows, width, 3]; `view` as for `displayed`."""
    global _entries
    with closing(_Display()) as display:
        for _ in read_view_files(display, scene, view):
            yield slice(0, 0), np.empty((0, width, 3), np.float32)
        start = 0
        while start < height:
            rows = slice(start, min(start + max(1, _entries // width), height))
            colors, begun = colors_of(rows), time.perf_counter()
            shown = display.show(scene, colors, view)
            took = max(time.perf_counter() - begun, 1e-6)
            wanted = int(colors.size // 3 * min(SLICE_SECONDS / took, 2.0))
            _entries = min(max(wanted, FEWEST_ENTRIES), MOST_ENTRIES)
            start = rows.stop
            yield rows, shown


def read_view_files(display: _Display, scene: bpy.types.Scene, view: dict[str, Any] | None) -> Iterator[None]:
    """Has Blender make ready what writes pictures, and then read the files of a view, as it does when it first colours
    anything with it: each takes as long as many slices, and is needed once."""
    black = np.zeros((1, 1, 3), np.float32)
    with suppress(TypeError):  # A colour configuration of the user's own may have no such view.
        display.show(scene, black, {"view_transform": WITHOUT_FILES})
    yield
    display.show(scene, black, view)
    yield


def displayed(scene: bpy.types.Scene, colors: np.ndarray, view: dict[str, Any] | None = None) -> np.ndarray:
    """Display colours as Blender makes them of opaque scene-linear ones, in 16 bits; both [height, width, 3]. With
    `view` in another view than the scene's: its `display_device` and properties of view settings."""
    with closing(_Display()) as display:
        return display.show(scene, colors, view)


class _Display:
    """Has Blender colour one picture after another in the same two images: whenever an image is removed, Blender puts
    all objects of its scenes together anew, which holds up large scenes for longer than the colouring."""

    def __init__(self) -> None:
        handle, name = tempfile.mkstemp(suffix=".png", dir=bpy.app.tempdir or None)
        os.close(handle)
        self._path = Path(name)
        self._linear: bpy.types.Image | None = None
        self._shown: bpy.types.Image | None = None

    def show(self, scene: bpy.types.Scene, colors: np.ndarray, view: dict[str, Any] | None = None) -> np.ndarray:
        """As `displayed`. After undo it may raise ReferenceError."""
        self._write(scene, colors, view)
        if self._shown is None:
            self._shown = bpy.data.images.load(str(self._path))
            self._shown.name = HIDDEN_NAME
            self._shown.colorspace_settings.name = "Non-Color"
        else:
            self._shown.reload()
        pixels = np.empty(len(self._shown.pixels), np.float32)
        self._shown.pixels.foreach_get(pixels)
        return pixels.reshape(*colors.shape[:2], -1)[..., :3]

    def _write(self, scene: bpy.types.Scene, colors: np.ndarray, view: dict[str, Any] | None) -> None:
        """Writes scene-linear colours, [height from the bottom, width, 3], as a 16-bit PNG of a view. No pixels stay in
        the image: with Ctrl S Blender would ask whether they are to be saved, too."""
        height, width = colors.shape[:2]
        pixels = np.ones((height, width, 4), np.float32)
        pixels[..., :3] = colors
        if self._linear is None:
            self._linear = bpy.data.images.new(HIDDEN_NAME, width, height, float_buffer=True)
        else:
            self._linear.generated_width, self._linear.generated_height = width, height
        self._linear.pixels.foreach_set(pixels.reshape(-1))
        with _png_settings(scene, view):
            self._linear.save_render(str(self._path), scene=scene)
        self._linear.buffers_free()
        # Blender reports success on a full disk.
        if not self._path.read_bytes().endswith(PNG_END):
            raise OSError(f"cannot write the view transform; check the free space: {self._path}")

    def close(self) -> None:
        """Removes images and file."""
        for image in (self._linear, self._shown):
            with suppress(ReferenceError):  # Undo, or another file, may have removed it.
                if image is not None:
                    bpy.data.images.remove(image)
        self._path.unlink(missing_ok=True)


@contextmanager
def _png_settings(scene: bpy.types.Scene, view: dict[str, Any] | None) -> Iterator[None]:
    """Sixteen bits, no dithering, coloured by the scene or a view of its own; all settings put back afterwards."""
    output = scene.render.image_settings
    wanted: list[tuple[Any, str, Any]] = [
        (output, "media_type", "IMAGE"),
        (output, "file_format", "PNG"),
        (output, "color_mode", "RGB"),
        (output, "color_depth", "16"),
        (output, "compression", 15),
        (output, "color_management", "OVERRIDE" if view else "FOLLOW_SCENE"),
        (scene.render, "dither_intensity", 0.0),
    ]
    for name, value in (view or {}).items():
        wanted.append((output.display_settings if name == "display_device" else output.view_settings, name, value))
    wanted = [(owner, name, value) for owner, name, value in wanted if hasattr(owner, name)]
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in wanted]
    try:
        for owner, name, value in wanted:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
