"""Relume: relights a finished shot with real materials and full global illumination."""


def register():
    """Called by Blender when the extension is enabled."""


def unregister():
    """Called by Blender when the extension is disabled."""
