"""Reads an evaluated Blender scene and feeds a scene builder. Never writes to the scene, never imports the native
module: the builder is passed in."""

from .scene import ExportError, ExportOptions, export_scene
from .settings import trace_settings
from .view_file import write_view_table

__all__ = [
    "ExportError",
    "ExportOptions",
    "export_scene",
    "trace_settings",
    "write_view_table",
]
