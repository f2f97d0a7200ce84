"""From the open Blender file to a native scene."""

from __future__ import annotations

from typing import Any

import bpy

from ..export import ExportOptions, export_scene
from .native import native
from .render_depsgraph import with_render_depsgraph

LINEAR_REC709 = "Linear Rec.709"


def load_scene(scene: bpy.types.Scene, options: ExportOptions | None = None) -> Any:
    """A `relume.Scene` of the present frame, as a final render would see it."""
    builder = native().SceneBuilder(working_space())
    if working_space() != LINEAR_REC709:
        builder.warn(f"working space {working_space()}: image textures and black bodies keep {LINEAR_REC709} primaries")
    with_render_depsgraph(scene, lambda depsgraph: export_scene(builder, depsgraph, options or ExportOptions()))
    return builder.build()


def working_space() -> str:
    """Name of the file's scene-linear space (chosen by the file from Blender 5.0 on)."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else LINEAR_REC709
