"""Follows the scene: what the artist changes becomes a request, new pictures become redraws."""

from __future__ import annotations

import time
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

from ..core import status
from ..engine import shot
from . import rows

TICK_SECONDS = 1 / 60
REST_SECONDS = 0.15
"""How long nothing must change until the full picture is asked for."""

_resting: dict[int, float] = {}
"""Scenes with a change in progress: when to ask for the full picture."""
_words: dict[int, tuple] = {}
"""What the panel says of each shot."""


def changed(scene: bpy.types.Scene, interactive: bool = False) -> None:
    """Asks for a picture of the present lights and rows of a scene. To be called by everything that changes them;
    `interactive` while something is being dragged."""
    found = shot.of(scene)
    if found is None:
        return
    lights = found.lights.descriptions
    asked = found.relight(lights, rows.mix(scene, [light["name"] for light in lights]), interactive)
    if not interactive:
        _resting.pop(scene.session_uid, None)
    elif asked:
        _resting[scene.session_uid] = time.monotonic() + REST_SECONDS
    wake()


def read_lights(scene: bpy.types.Scene) -> None:
    """Reads all lights of a scene anew and asks for their picture."""
    found, depsgraph = shot.of(scene), _depsgraph(scene)
    if found is None or depsgraph is None:
        return
    found.lights.read(depsgraph)
    changed(scene)


def _depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The evaluated state of a scene that some window shows."""
    if bpy.context.scene == scene:
        return bpy.context.evaluated_depsgraph_get()
    return next((layer.depsgraph for layer in scene.view_layers if layer.depsgraph), None)


def wake() -> None:
    """Starts polling; it ends by itself when nothing runs."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, persistent=True)


def _timer() -> float | None:
    return TICK_SECONDS if tick() else None


def tick() -> bool:
    """One turn of polling. Whether there is to be another one."""
    now = time.monotonic()
    for scene in bpy.data.scenes:
        if _resting.get(scene.session_uid, now + 1.0) <= now:
            changed(scene)
    for found in shot.all_open():
        frame = found.frame
        if found.poll():
            _redraw(found, new_picture=found.frame is not frame)
    return bool(_resting) or any(found.is_busy for found in shot.all_open())


def _redraw(found: shot.Shot, new_picture: bool) -> None:
    """Views for a new picture, the sidebar where its words have changed."""
    words = (status.headline(found.status), status.shown(found.status), status.progress(found.status))
    new_words = _words.get(found.scene_uid) != words
    _words[found.scene_uid] = words
    kinds = {"WINDOW", "UI"} if new_picture else {"UI"} if new_words else set()
    for region in _regions_of_views():
        if region.type in kinds:
            region.tag_redraw()


def _regions_of_views() -> Iterator[bpy.types.Region]:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield from area.regions


@persistent
def on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Something was edited: perhaps lights."""
    found = shot.of(scene)
    if found is not None and found.lights.update(depsgraph):
        changed(scene, interactive=True)


@persistent
def on_frame_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Another frame of the animation is shown. Renders call this from a thread of their own."""
    if not bpy.app.is_job_running("RENDER"):
        on_depsgraph_update(scene, depsgraph)


@persistent
def on_undo(scene: bpy.types.Scene, *_arguments) -> None:
    """Undo and redo may have changed anything."""
    read_lights(scene)


@persistent
def on_load_pre(*_arguments) -> None:
    """Another file is about to be opened."""
    close_all()


def close_all() -> None:
    """Ends all work, without waiting."""
    shot.close_all()
    _resting.clear()
    _words.clear()


HANDLERS = {
    "depsgraph_update_post": on_depsgraph_update,
    "frame_change_post": on_frame_change,
    "undo_post": on_undo,
    "redo_post": on_undo,
    "load_pre": on_load_pre,
}


def register():
    """Adds the handlers."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)


def unregister():
    """Ends all work and removes handlers and timer."""
    close_all()
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
