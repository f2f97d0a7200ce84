"""The scene-linear space of the open file."""

from __future__ import annotations

import bpy

LINEAR_REC709 = "Linear Rec.709"


def working_space() -> str:
    """Its name; files choose it from Blender 5.0 on."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else LINEAR_REC709
