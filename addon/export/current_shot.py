"""The shot of a scene's list that is current: the one whose camera and frame the scene has."""

from __future__ import annotations

from typing import Any

import bpy


def shot_camera(entry: Any) -> bpy.types.Object | None:
    """The camera of a listed shot: the object itself under whatever name, or, where that was deleted, one of its last
    name. None if the scene has neither."""
    objects = entry.id_data.objects
    known = objects.get(entry.camera.name) if entry.camera is not None else None
    camera = known if _is_same(known, entry.camera) else objects.get(entry.camera_name)
    return camera if camera is not None and camera.type == "CAMERA" else None


def _is_same(one: bpy.types.Object | None, other: bpy.types.Object | None) -> bool:
    """True for an object and its evaluated copy, which renders have."""
    return one is not None and other is not None and one.original == other.original


def entries(scene: bpy.types.Scene) -> list[Any]:
    """All entries of a scene's list; none where nobody has made one, and where the add-on has no panels."""
    state = getattr(scene, "relume_shots", None)
    return list(state.items) if state is not None else []


def current_entry(scene: bpy.types.Scene) -> Any:
    """The active shot if the scene has its camera and its frame, else the first one of which that is so. None
    otherwise: the scene then has its automatic shot."""
    return next(iter(current_entries(scene)), None)


def current_entries(scene: bpy.types.Scene) -> list[Any]:
    """The shots of the scene's camera and frame, such as those of several view layers; the active one first."""
    active = active_entry(scene)
    found = [entry for entry in entries(scene) if _is_current(scene, entry)]
    return sorted(found, key=lambda entry: entry != active)


def active_entry(scene: bpy.types.Scene) -> Any:
    """The entry that is chosen in the list; None where there is none."""
    state = getattr(scene, "relume_shots", None)
    return state.items[state.active] if state is not None and 0 <= state.active < len(state.items) else None


def _is_current(scene: bpy.types.Scene, entry: Any) -> bool:
    if entry.is_foreign or not _is_same(shot_camera(entry), scene.camera):
        return False
    return not entry.use_frame or entry.frame == scene.frame_current


def current_size(scene: bpy.types.Scene) -> tuple[int, int] | None:
    """Width and height of the current shot, where that has a size of its own."""
    entry = current_entry(scene)
    return (entry.width, entry.height) if entry is not None and entry.use_size else None
