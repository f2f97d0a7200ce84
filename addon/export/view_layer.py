"""The view layer that a scene is read with."""

from __future__ import annotations

import bpy


def render_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """First view layer that Blender renders; the window's where *Render Single Layer* is on."""
    windows = bpy.context.window_manager.windows if scene.render.use_single_layer else ()
    shown = [window.view_layer for window in windows if window.scene == scene and window.view_layer.use]
    return next(iter([*shown, *(layer for layer in scene.view_layers if layer.use)]), scene.view_layers[0])
