"""The scene follows the shot that is chosen in the list: its camera, its frame, its view layer, and its bake."""

from __future__ import annotations

import dataclasses

import bpy

from ..core.phase import ShotPhase
from ..core.shots import AUTOMATIC
from ..engine.shot import open_shots, shot_list
from ..engine.shot import shot as shots
from ..export.current_shot import active_entry, current_entry, entries, shot_camera
from . import opening
from .scheduler import scheduler


def follow(scene: bpy.types.Scene) -> None:
    """Makes the chosen shot the current one, and shows its bake. A bake of another file has no camera here."""
    entry = active_entry(scene)
    camera = shot_camera(entry) if entry is not None and not entry.is_foreign else None
    if camera is None:
        return
    scene.camera = camera
    if entry.use_frame and scene.frame_current != entry.frame:
        scene.frame_set(entry.frame)
    if (layer := scene.view_layers.get(entry.layer)) is not None:
        for window in bpy.context.window_manager.windows:
            if window.scene == scene:
                window.view_layer = layer
    show(scene)


def show(scene: bpy.types.Scene) -> None:
    """Shows the bake of the current shot, or nothing where it has none. A bake under way is left alone."""
    adopt(scene)
    opened, entry = shots.of(scene), current_entry(scene)
    if entry is None or (opened is not None and (_is_baking(opened) or opened.key == entry.key)):
        return
    if (beside := open_shots.by_key(scene, entry.key)) is not None:
        open_shots.add_current(beside)
        scheduler.wake()
    elif shot_list.baked_folder(scene, entry) is not None:
        _show_stored(scene)
    elif opened is not None:
        opened.close()


def after_undo(scene: bpy.types.Scene) -> None:
    """Shows the current shot again where undo or redo has chosen another one, or has taken a list or brought it
    back."""
    opened = shots.of(scene)
    if opened is None:
        return
    if opened.key not in {AUTOMATIC, *(entry.key for entry in entries(scene))}:
        _name(opened, AUTOMATIC)
        if not entries(scene) and not _is_baking(opened) and not _is_of_camera(scene, opened):
            opened.close()
            _show_stored(scene)
    show(scene)


def _show_stored(scene: bpy.types.Scene) -> None:
    if opening.open_stored(scene) is not None:
        scheduler.read_lights(scene)


def _is_baking(opened: shots.Shot) -> bool:
    """True unless a bake is only shown, or about to be."""
    return opened.is_working and not (opened.phase is ShotPhase.PREPARING and opened.is_recorded)


def _is_of_camera(scene: bpy.types.Scene, opened: shots.Shot) -> bool:
    return scene.camera is not None and opened.recognises(scene.camera)


def adopt(scene: bpy.types.Scene) -> None:
    """Takes the open shot of a scene that had no list for the one that its camera has in the list, unless that has a
    bake elsewhere."""
    opened, entry = shots.of(scene), current_entry(scene)
    if opened is None or entry is None or opened.key != AUTOMATIC or not _is_of_camera(scene, opened):
        return
    if _is_baking(opened) or shot_list.baked_folder(scene, entry) in {None, opened.folder}:
        _name(opened, entry.key)


def _name(opened: shots.Shot, key: str) -> None:
    opened.options = dataclasses.replace(opened.options, shot=key)
