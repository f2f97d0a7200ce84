"""Relume: relights finished Blender shots with real materials and full global illumination."""

from ._native import RelumeError, Scene, SceneBuilder, __version__

__all__ = ["RelumeError", "Scene", "SceneBuilder", "__version__"]
