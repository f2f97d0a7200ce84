"""Frames on the graphics card: uploaded once, developed once for each view transform, freed when out of use."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import gpu
import numpy as np

from . import shader
from .view_table import View

_pictures: dict[int, Picture] = {}
"""By identity of the frame, which the picture keeps alive."""
_tables: dict[int, tuple[np.ndarray, Any]] = {}
"""Newest last, by identity of the table, which is kept alive."""
TABLES_KEPT = 3
NO_TABLE = np.zeros((1, 1, 1, 4), np.float32)


class Picture:
    """One frame, in the display colours of one view at a time."""

    def __init__(self, frame: Any):
        self.frame = frame
        height, width = frame.image.shape[:2]
        self.size = (width, height)
        self.linear = _upload(self.size, frame.image)
        self._developed = gpu.types.GPUTexture(self.size, format="RGBA16F")
        self.view: View | None = None

    def developed(self, view: View) -> Any:
        """The texture of display colours, premultiplied by alpha."""
        if self.view != view:
            self._develop(view)
            self.view = view
        return self._developed

    def _develop(self, view: View) -> None:
        program = shader.develop()
        blend = gpu.state.blend_get()
        # Made for this once: the graphics contexts of two windows share textures, but no framebuffers. (Making a
        # GPUOffScreen would leave the 3D view's own framebuffer unbound.)
        framebuffer = gpu.types.GPUFrameBuffer(color_slots=self._developed)
        with framebuffer.bind():
            gpu.state.blend_set("NONE")
            program.shader.bind()
            program.shader.uniform_sampler("image", self.linear)
            program.shader.uniform_sampler("table", _table_of(view))
            program.shader.uniform_float("scale", view.scale)
            program.shader.uniform_float("exponent", view.exponent)
            program.shader.uniform_int("use_table", int(view.table is not None))
            program.square.draw(program.shader)
        gpu.state.blend_set(blend)


def picture_of(frame: Any) -> Picture:
    """The frame on the graphics card. Only while drawing."""
    found = _pictures.get(id(frame))
    if found is None:
        found = _pictures[id(frame)] = Picture(frame)
    return found


def keep_only(frames: Iterable[Any]) -> None:
    """Lets go of the pictures of all other frames; Blender frees their memory."""
    wanted = {id(frame) for frame in frames}
    for key in [key for key in _pictures if key not in wanted]:
        del _pictures[key]


def free() -> None:
    """Frees everything."""
    keep_only(())
    _tables.clear()
    encoding.cache_clear()
    shader.free()


@cache
def encoding() -> Any:
    """The table of `shader.overlay_encoding`."""
    values = shader.overlay_encoding()
    return gpu.types.GPUTexture(values.size, format="R32F", data=gpu.types.Buffer("FLOAT", values.size, values))


def _upload(size: tuple[int, ...], pixels: np.ndarray) -> Any:
    """Half floats: the same colours to 1/20 of a display step, in half the time."""
    flat = np.ascontiguousarray(pixels, np.float32).reshape(-1)
    return gpu.types.GPUTexture(size, format="RGBA16F", data=gpu.types.Buffer("FLOAT", flat.size, flat))


def _table_of(view: View) -> Any:
    table = NO_TABLE if view.table is None else view.table
    if id(table) not in _tables:
        _tables[id(table)] = table, _upload(table.shape[2::-1], table)
        while len(_tables) > TABLES_KEPT:
            del _tables[next(iter(_tables))]
    return _tables[id(table)][1]
