"""Frames and tables on the graphics card: uploaded once, freed when out of use. Only to be made while drawing."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

import gpu
import numpy as np

from . import shader
from .view_table import View

TABLES_KEPT = 3
NO_TABLE = np.zeros((1, 1, 1, 4), np.float32)

_frames: dict[int, tuple[Any, Any]] = {}
"""Frame and texture, by identity of the frame, which is kept alive."""
_tables: dict[int, tuple[np.ndarray, Any]] = {}
"""The same of view tables, newest last."""


def of_frame(frame: Any) -> Any:
    """The scene-linear pixels of a frame."""
    if id(frame) not in _frames:
        height, width = frame.image.shape[:2]
        _frames[id(frame)] = frame, _upload((width, height), frame.image)
    return _frames[id(frame)][1]


def of_table(view: View) -> Any:
    """The table of a view; something to bind if it has none."""
    table = NO_TABLE if view.table is None else view.table
    if id(table) not in _tables:
        _tables[id(table)] = table, _upload(table.shape[2::-1], table)
        while len(_tables) > TABLES_KEPT:
            del _tables[next(iter(_tables))]
    return _tables[id(table)][1]


@cache
def encoding() -> Any:
    """The table of `shader.overlay_encoding`."""
    values = shader.overlay_encoding()
    return gpu.types.GPUTexture(values.size, format="R32F", data=gpu.types.Buffer("FLOAT", values.size, values))


def keep_only(frames: Iterable[Any]) -> None:
    """Lets go of all other frames; Blender frees their memory."""
    wanted = {id(frame) for frame in frames}
    for key in [key for key in _frames if key not in wanted]:
        del _frames[key]


def free() -> None:
    """Lets go of everything."""
    _frames.clear()
    _tables.clear()
    encoding.cache_clear()
    shader.free()


def _upload(size: tuple[int, ...], pixels: np.ndarray) -> Any:
    """Half floats: the same colours to 1/20 of a display step, in half the time."""
    flat = np.ascontiguousarray(pixels, np.float32).reshape(-1)
    return gpu.types.GPUTexture(size, format="RGBA16F", data=gpu.types.Buffer("FLOAT", flat.size, flat))
