"""Modules that need no Blender."""
