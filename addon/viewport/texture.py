"""Frames and tables on the graphics card: uploaded once, freed when out of use. Only to be made while drawing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gpu
import numpy as np

from . import shader
from .view_table import ViewTable

TABLES_KEPT = 3

_frames: dict[int, tuple[Any, Any]] = {}
"""Frame and texture, by identity of the frame, which is kept alive."""
_tables: dict[int, tuple[np.ndarray, Any]] = {}
"""Textures of view tables, newest last."""
_levels: dict[int, tuple[Any, Any]] = {}
"""Textures of the tables' lists of colours, or none."""


def of_frame(frame: Any) -> Any:
    """The scene-linear pixels of a frame."""
    if id(frame) not in _frames:
        height, width = frame.image.shape[:2]
        _frames[id(frame)] = frame, _upload((width, height), frame.image)
    return _frames[id(frame)][1]


def of_table(view: ViewTable) -> Any:
    """The table of a view that has one."""
    table = view.table
    assert table is not None
    if id(table) not in _tables:
        # Places in a list of colours are finer than half floats.
        exact = view.levels is not None
        _tables[id(table)] = table, _upload(table.shape[2::-1], table, "RGBA32F" if exact else "RGBA16F")
        _forget(_tables)
    return _tables[id(table)][1]


def of_levels(view: ViewTable) -> Any:
    """The view's list of colours, if it has one, and in alpha `shader.overlay_encoding`."""
    key = id(view.levels)
    if key not in _levels:
        values = np.zeros((shader.ENCODING_ENTRIES, 4), np.float32)
        values[:, 3] = shader.overlay_encoding()
        if view.levels is not None:
            values[:, :3] = view.levels
        _levels[key] = view.levels, _upload((len(values),), values, "RGBA32F")
        _forget(_levels)
    return _levels[key][1]


def _forget(tables: dict) -> None:
    """Drops the oldest."""
    while len(tables) > TABLES_KEPT:
        del tables[next(iter(tables))]


def keep_only(frames: Iterable[Any]) -> None:
    """Lets go of all other frames; Blender frees their memory."""
    kept_ids = {id(frame) for frame in frames}
    for key in [key for key in _frames if key not in kept_ids]:
        del _frames[key]


def free() -> None:
    """Lets go of everything."""
    _frames.clear()
    _tables.clear()
    _levels.clear()
    shader.free()


def _upload(size: tuple[int, ...], pixels: np.ndarray, texels: str = "RGBA16F") -> Any:
    """Half floats: the same colours to 1/20 of a display step, in half the time."""
    flat = np.ascontiguousarray(pixels, np.float32).reshape(-1)
    return gpu.types.GPUTexture(size, format=texels, data=gpu.types.Buffer("FLOAT", flat.size, flat))
