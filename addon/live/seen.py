"""The shots that 3D views show through cameras of their own: opened beside the current one of their scene as long as a
view shows them. Pictures of the view under the mouse come first."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import bpy

from ..engine.native import NativeModuleError
from ..engine.shot import listed_view, open_shots
from ..engine.shot.checks import folders_in_use
from ..engine.shot.shot import Shot
from ..viewport import views

LOOK_SECONDS = 1.0
"""Seconds between looks at the disk for bakes that are not there."""

_looked: dict[tuple[int, str], float] = {}
"""Times at which shots that are not shown were last looked at, by the scene's session uid and the shot's key."""
_mouse: int | None = None
"""Area that the mouse was in last."""
_attended: Shot | None = None
_shown: tuple[tuple[int, int], ...] = ()
"""Areas and cameras of the views that were drawn last."""
_handles: list[Any] = []
_cursors: list[Any] = []


def follow(scene: bpy.types.Scene) -> bool:
    """Opens the shots that views of a scene show through cameras of their own where a shot of it is open, one at a
    time; closes those that none shows any more. Returns True if one was opened."""
    if not open_shots.all_of(scene):
        return False
    through = list(views.through_cameras(scene))
    wanted: dict[str, tuple[Any, str]] = {}
    for view in through:
        if view.is_local and (entry := listed_view.entry_of(scene, view.camera)) is not None:
            wanted.setdefault(entry.key, (entry, view.layer))
    for shot in open_shots.all_of(scene):
        shot.is_seen_beside = shot.key in wanted
    busy = folders_in_use(scene)
    for shot in open_shots.beside(scene):
        if not shot.is_seen_beside or shot.folder in busy or listed_view.other_state(scene, *wanted[shot.key]):
            shot.close()
    current = open_shots.of(scene)
    shown = [open_shots.showing(scene, view.camera) for view in through]
    if current is not None:
        current.is_seen = current in shown or not open_shots.beside(scene)
    _follow_mouse(bool(wanted))
    _attend(scene, through)
    missing = [found for key, found in wanted.items() if open_shots.by_key(scene, key) is None]
    return any(_open(scene, entry, layer, busy) for entry, layer in missing if _is_due(scene, entry))


def _is_due(scene: bpy.types.Scene, entry: Any) -> bool:
    key, now = (scene.session_uid, entry.key), time.monotonic()
    if now - _looked.get(key, 0.0) < LOOK_SECONDS:
        return False
    _looked[key] = now
    return True


def _open(scene: bpy.types.Scene, entry: Any, layer: str, busy: dict[Any, str]) -> bool:
    """Opens a shot beside the current one; says in its view why it cannot."""
    opened = None
    try:
        words = listed_view.why_not(scene, entry, layer)
        if not words and listed_view.shot_list.baked_folder(scene, entry) in busy:
            words = "is being baked"
        if not words:
            opened = Shot.open(scene, beside=entry)
    except (NativeModuleError, RuntimeError, OSError, ValueError) as error:
        words = f"cannot be shown: {' '.join(str(error).split())}"
    if listed_view.refuse(scene, entry, words):
        views.redraw("WINDOW")
    if opened is not None:
        opened.is_seen_beside = True
        _looked.pop((scene.session_uid, entry.key), None)
    return opened is not None


def _attend(scene: bpy.types.Scene, through: list[views.View]) -> None:
    """Has the pictures of the view under the mouse made first, or else those of the current shot."""
    global _attended
    under = next((view for view in through if view.area == _mouse), None)
    found = open_shots.showing(scene, under.camera) if under is not None else None
    if found is None and (_attended is None or not _attended.is_open):
        found = next(iter(open_shots.all_of(scene)), None)
    if found is not None and found is not _attended:
        _attended = found
        found.attend()


def _follow_mouse(is_needed: bool) -> None:
    """Blender says where the mouse is by having a cursor drawn there, which it need not do for one shot alone."""
    if bpy.app.background or is_needed == bool(_cursors):
        return
    if is_needed:
        _cursors.append(bpy.types.WindowManager.draw_cursor_add(_note_mouse, (), "VIEW_3D", "WINDOW"))
    else:
        bpy.types.WindowManager.draw_cursor_remove(_cursors.pop())


def _note_mouse(_place: tuple[int, int]) -> None:
    area = bpy.context.area
    if area is not None:
        note_area(area)


def note_area(area: bpy.types.Area) -> None:
    """Notes that the mouse is in an area."""
    global _mouse
    if area.as_pointer() != _mouse:
        _mouse = area.as_pointer()
        _wake()


def _note_drawn() -> None:
    """Called by Blender for every 3D view: wakes the scheduler where other cameras are shown than before."""
    global _shown
    scene = bpy.context.scene
    through = views.through_cameras(scene) if open_shots.all_of(scene) else ()
    shown = tuple((view.area, view.camera.session_uid) for view in through)
    if shown != _shown:
        _shown = shown
        _wake()


def _sleep() -> None:
    """Stands for the scheduler until it is there."""


_wake: Callable[[], None] = _sleep


def register(wake: Callable[[], None]) -> None:
    """Has `wake` called when views show other cameras, or the mouse is in another one."""
    global _wake
    _wake = wake
    if not bpy.app.background:
        _handles.append(bpy.types.SpaceView3D.draw_handler_add(_note_drawn, (), "WINDOW", "POST_PIXEL"))


def unregister() -> None:
    """Removes the handlers."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    _follow_mouse(False)
    forget()


def forget() -> None:
    """Forgets all that was noticed, before another file is opened."""
    global _mouse, _attended, _shown
    _mouse, _attended, _shown = None, None, ()
    _looked.clear()
    listed_view.forget()
