"""Opening of stored bakes."""

from __future__ import annotations

import bpy

from ..core.bake_folder import is_bake
from ..engine.native import NativeModuleError
from ..engine.shot.options import FolderError, bake_folder, remembered_bake
from ..engine.shot.shot import Shot
from ..viewport.views import redraw

_refusals: dict[int, str] = {}
"""Reasons why stored bakes could not be shown, by scene."""


def open_stored(scene: bpy.types.Scene) -> Shot | None:
    """Opens the bake that a scene remembers, or that its folder holds. None where there is none, or where it cannot be
    opened: the panel says why."""
    _refusals.pop(scene.session_uid, None)
    try:
        return Shot.open(scene) if is_bake(remembered_bake(scene) or bake_folder(scene)) else None
    except (NativeModuleError, RuntimeError, FolderError) as error:
        _refusals[scene.session_uid] = f"The bake of this scene could not be opened: {' '.join(str(error).split())}"
        redraw("UI")
        return None


def why_not_open(scene: bpy.types.Scene) -> str:
    """Reason why the stored bake of a scene was not shown when its file was opened; empty if nothing went wrong."""
    return _refusals.get(scene.session_uid, "")


def forget() -> None:
    """Forgets all reasons."""
    _refusals.clear()
