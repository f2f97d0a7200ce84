"""From the open Blender file to a native scene."""

from __future__ import annotations

from typing import Any

import bpy

from ..export import ExportOptions, export_scene
from .native import native
from .render_depsgraph import with_render_depsgraph


def load_scene(scene: bpy.types.Scene, options: ExportOptions | None = None) -> Any:
    """A `relume.Scene` of the present frame, as a final render would see it."""
    builder = native().SceneBuilder(working_space())
    with_render_depsgraph(scene, lambda depsgraph: export_scene(builder, depsgraph, options or ExportOptions()))
    return builder.build()


def working_space() -> str:
    """Name of the file's scene-linear space (chosen by the file from Blender 5.0 on)."""
    colorspace = getattr(bpy.data, "colorspace", None)
    return colorspace.working_space if colorspace else "Linear Rec.709"
