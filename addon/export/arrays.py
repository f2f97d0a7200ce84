"""Arrays in Blender's memory, and memory for copies out of it. Blender copies with Python's lock held, and its window
waits for that lock; numpy lets go of it."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np

LAYOUTS: dict[str, tuple[Any, int]] = {
    "BOOLEAN": (np.bool_, 1),
    "INT8": (np.int8, 1),
    "INT16_2D": (np.int16, 2),
    "INT": (np.int32, 1),
    "INT32_2D": (np.int32, 2),
    "FLOAT": (np.float32, 1),
    "FLOAT2": (np.float32, 2),
    "FLOAT_VECTOR": (np.float32, 3),
    "BYTE_COLOR": (np.uint8, 4),
    "FLOAT_COLOR": (np.float32, 4),
    "QUATERNION": (np.float32, 4),
}
"""Layout for `stored` of an attribute's values, by its type."""


def stored(collection: Any, dtype: Any, width: int = 1) -> np.ndarray:
    """The memory of a collection whose elements are `width` numbers each and lie one after the other, as those of
    attributes do: [N], or [N, width]. Not to be written to, and gone with what it belongs to: a thread that reads a
    render's meshes may do so until the render ends, others until they return to Blender. Raises RuntimeError of a
    collection whose elements do not lie so."""
    count = len(collection)
    shape = (count,) if width == 1 else (count, width)
    if count == 0:
        return np.empty(shape, dtype)
    size = width * np.dtype(dtype).itemsize
    first, last = collection[0].as_pointer(), collection[count - 1].as_pointer()
    if last - first != (count - 1) * size:
        raise RuntimeError(f"the elements of {collection!r} do not lie one after the other")
    array = np.frombuffer((ctypes.c_uint8 * (count * size)).from_address(first), dtype).reshape(shape)
    array.flags.writeable = False
    return array


def touched(shape: Any, dtype: Any) -> np.ndarray:
    """An array whose pages are all there. The system makes them when they are first written to, which takes 0.6 s for
    an image of 4096 x 4096 pixels: numpy lets go of Python's lock meanwhile, while Blender's `foreach_get` would hold
    up the window."""
    array = np.empty(shape, dtype)
    array.fill(0)
    return array
