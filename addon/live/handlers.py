"""Handlers of Blender's events: edits, undo, saving, loading, renders."""

from __future__ import annotations

import atexit

import bpy
from bpy.app.handlers import persistent

from ..engine.reading.render_depsgraph import on_render_init, remove_copies
from ..engine.shot import open_shots
from ..engine.shot import shot as shots
from ..engine.shot.options import preferences, remember_bake, remembered_bake
from . import follow, opening, rows, seen
from .scheduler import IDLE_SECONDS, scheduler

EXIT_SECONDS = 5.0
"""Seconds that Blender's exit waits for work to end."""
OPEN_SECONDS = 0.1
"""Seconds until the bakes of a file are opened: it should be on screen first."""


@persistent
def on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Notices edits of the scene, of its lights and of their names."""
    if rows.are_outdated(scene, depsgraph):
        _sync_rows([scene])
    found = open_shots.all_of(scene)
    if not found or depsgraph.mode != "VIEWPORT":
        return
    open_shots.showing(scene, scene.camera)  # It may have a new name.
    updates = list(depsgraph.updates)
    lights = [lights.update(depsgraph, scheduler.read_seconds) for lights in open_shots.lights_of(scene)]
    worlds = [shot.changes.mark(scene, updates) for shot in found]
    if any(lights) or any(worlds):
        scheduler.request_picture(scene, interactive=True)
    scheduler.wake()


def _sync_rows(scenes: list[bpy.types.Scene]) -> None:
    """Makes rows follow their scenes, in a window in a tick of their own: lights are read in this one."""
    rows.mark_outdated(scenes)
    if bpy.app.background:
        rows.sync_due()
    else:
        scheduler.wake()


@persistent
def on_frame_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Notices that another frame is shown. Renders call this from a thread of their own."""
    found = open_shots.all_of(scene)
    if found and not bpy.app.is_job_running("RENDER"):
        for shot in found:
            shot.changes.mark_frame()
        on_depsgraph_update(scene, depsgraph)


@persistent
def on_undo(*_arguments) -> None:
    """Undo and redo may have changed anything, in every scene."""
    _sync_rows(list(bpy.data.scenes))
    scheduler.skip_exclusive()
    remove_copies()
    _remember_bakes()
    for shot in shots.all_open():
        shot.changes.mark_all()
        shot.lights.forget()
    if bpy.app.background:
        read_forgotten()
    else:  # As a rule an update comes before.
        scheduler.defer(read_forgotten, IDLE_SECONDS)


def read_forgotten() -> None:
    """Shows the shots that are current since undo, reads lights anew where no update of their scene has had them read
    since then, and asks for what has become of the rows."""
    # A scene that no window shows is not evaluated again before it is shown; its old state may hold data that undo has
    # freed.
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        follow.after_undo(scene)
        found = open_shots.lights_of(scene)
        if any(lights.is_forgotten for lights in found):
            scheduler.read_lights(scene)
        elif not any(lights.is_waiting for lights in found):
            scheduler.request_picture(scene)


@persistent
def on_save_pre(*_arguments) -> None:
    """The file is about to be written."""
    _remember_bakes()
    for scene in bpy.data.scenes:
        shot = open_shots.showing(scene, scene.camera)
        if shot is not None:
            shot.keep_record()


def _remember_bakes() -> None:
    """Restores the locations of bakes, which must not go back with undo."""
    for scene in bpy.data.scenes:
        for shot in open_shots.all_of(scene):
            if shot.is_stored and remembered_bake(scene, shot.key) != shot.folder:
                remember_bake(scene, shot.folder, shot.key)


@persistent
def on_load_pre(*_arguments) -> None:
    """Closes all shots before another file is opened."""
    scheduler.close_all()


@persistent
def on_load_post(*_arguments) -> None:
    """A file was opened."""
    rows.find_by_name()
    on_load_post_fail()


@persistent
def on_load_post_fail(*_arguments) -> None:
    """A file could not be opened, and the one before stays."""
    chosen = preferences()
    if not bpy.app.background and chosen is not None and chosen.open_bakes:
        scheduler.defer(open_bakes, OPEN_SECONDS)


def open_bakes() -> None:
    """Opens every bake that the file remembers, or that was made in the background after it was closed."""
    for scene in bpy.data.scenes:
        if shots.of(scene) is None and opening.open_stored(scene):
            scheduler.read_lights(scene)


def _exit() -> None:
    """Threads must not outlive the libraries that they use."""
    scheduler.close_all(EXIT_SECONDS)


HANDLERS = {
    "depsgraph_update_post": on_depsgraph_update,
    "frame_change_post": on_frame_change,
    "undo_post": on_undo,
    "redo_post": on_undo,
    "save_pre": on_save_pre,
    "load_pre": on_load_pre,
    "load_post": on_load_post,
    "load_post_fail": on_load_post_fail,
    "render_init": on_render_init,
}


def register() -> None:
    """Adds the handlers."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    atexit.register(_exit)
    seen.register(scheduler.wake)
    if hasattr(bpy.data, "scenes"):  # Not while Blender itself starts; a file is opened then anyway.
        rows.find_by_name()


def unregister() -> None:
    """Ends all work and removes the handlers."""
    scheduler.close_all()
    seen.unregister()
    rows.forget()
    atexit.unregister(_exit)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
