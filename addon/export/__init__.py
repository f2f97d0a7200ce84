"""Reads an evaluated Blender scene and feeds a scene builder. Never writes to the scene, never imports the native
module: the builder is passed in."""

from .scene import ExportOptions, export_scene

__all__ = ["ExportOptions", "export_scene"]
