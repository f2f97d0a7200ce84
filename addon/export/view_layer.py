"""The view layer that a scene is read with."""

from __future__ import annotations

from typing import Any

import bpy

from .current_shot import current_entries, current_entry

_forced: dict[int, str] = {}
"""Names of view layers by the session uids of scenes, whatever shot is current; empty for the first that is
rendered."""


def force_layer(scene: bpy.types.Scene, name: str) -> None:
    """Has a scene be read with this view layer until `free_layers`; with the first one that is rendered for an empty
    name."""
    _forced[scene.session_uid] = name


def free_layers() -> None:
    """Ends what `force_layer` began."""
    _forced.clear()


def render_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that was forced, or that the current shot of the list names. Otherwise the first one that Blender
    renders."""
    shot, name = current_entry(scene), _forced.get(scene.session_uid)
    if name is None:
        name = shot.layer if shot is not None else ""
    if (layer := scene.view_layers.get(name)) is not None:
        return layer
    return first_rendered(scene)


def entry_of_layer(scene: bpy.types.Scene, layer: str) -> Any:
    """The listed shot that a final render of a view layer is of: one of the scene's camera and frame, the current one
    before others. None if there is none."""
    first = first_rendered(scene).name
    found = [entry for entry in current_entries(scene) if (entry.layer or first) == layer]
    return next(iter(found), None)


def first_rendered(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that Blender renders first; the window's where *Render Single Layer* is on."""
    windows = bpy.context.window_manager.windows if scene.render.use_single_layer else ()
    shown = [window.view_layer for window in windows if window.scene == scene and window.view_layer.use]
    return next(iter([*shown, *(layer for layer in scene.view_layers if layer.use)]), scene.view_layers[0])
