"""Memory for what Blender copies out."""

from __future__ import annotations

from typing import Any

import numpy as np


def touched(shape: Any, dtype: Any) -> np.ndarray:
    """An array whose pages are all there. The system makes them when they are first written to, which takes 0.6 s for
    an image of 4096 x 4096 pixels: numpy lets go of Python's lock meanwhile, while Blender's `foreach_get` would hold
    up the window."""
    array = np.empty(shape, dtype)
    array.fill(0)
    return array
