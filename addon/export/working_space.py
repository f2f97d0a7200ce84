"""The scene-linear space of the open file."""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Color

LINEAR_REC709 = "Linear Rec.709"


def working_space() -> str:
    """Its name; files choose it from Blender 5.0 on."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else LINEAR_REC709


def rec709_from_scene_linear() -> np.ndarray:
    """Matrix [3, 3] from the space to Linear Rec.709; colours of wider gamuts get channels below 0."""
    columns = [Color(axis).from_scene_linear_to_rec709_linear() for axis in np.eye(3)]
    return np.array(columns, np.float32).T
