"""The scene-linear space of the open file."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
from mathutils import Color

LINEAR_REC709 = "Linear Rec.709"


def working_space() -> str:
    """Name of the file's working space, which files choose from Blender 5.0 on."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else LINEAR_REC709


def rec709_from_scene_linear() -> np.ndarray:
    """Matrix [3, 3] from the space to Linear Rec.709; colours of wider gamuts get channels below 0."""
    return _matrix(Color.from_scene_linear_to_rec709_linear)


def scene_linear_from_rec709() -> np.ndarray:
    """Matrix [3, 3] from Linear Rec.709 to the space."""
    return _matrix(Color.from_rec709_linear_to_scene_linear)


def _matrix(turned: Callable[[Color], Color]) -> np.ndarray:
    columns = [turned(Color(axis)) for axis in np.eye(3)]
    return np.array(columns, np.float32).T
