"""Follows the scene: what the artist changes becomes a request, new pictures become redraws."""

from __future__ import annotations

import atexit
import math
import time
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..core.bake_folder import is_bake
from ..engine.native import NativeModuleError
from ..engine.reading.render_depsgraph import settle_settings, show_settings
from ..engine.reading.scene_lights import Description
from ..engine.shot import shot as shots
from ..engine.shot.checks import folders_in_use
from ..engine.shot.options import FolderError, bake_folder, preferences, remember_bake, remembered_bake
from ..viewport.views import redraw
from . import redraws, render_pass, rows

TICK_SECONDS = 1 / 60
QUIET_SECONDS = 0.25
"""Seconds between polls while nothing new comes, such as while work is paused."""
REST_SECONDS = 0.15
"""Seconds without a change until the full picture is asked for."""
EXIT_SECONDS = 5.0
"""Seconds that Blender's exit waits for work to end."""
FILES_SECONDS = 2.0
"""Seconds between checks of image files."""
LOOK_SECONDS = 0.005
"""Seconds in one tick for finding what has changed since the bake."""
READ_SECONDS = math.inf if bpy.app.background else 0.01
"""Seconds in one tick for reading lights: without a window there are no ticks."""

_is_quiet = False
"""True if the next poll is a while away."""
_was_given = False
"""True if the previous tick ran exclusive work, or undo has just made lights be read. Two exclusive ticks never follow
each other, so that dragging stays responsive."""
_resting: dict[int, float] = {}
"""Scenes with a change in progress: when to ask for the full picture."""
_unopened: dict[int, str] = {}
"""Scenes whose stored bake could not be shown: why."""


def changed(scene: bpy.types.Scene, interactive: bool = False, world: Any = None) -> None:
    """Asks for a picture of the present lights and rows of a scene. To be called by everything that changes them;
    `interactive` while something is being dragged, `world` as `Shot.relight` takes it."""
    shot = shots.of(scene)
    if shot is None:
        return
    content = content_of(scene, shot)
    asked = shot.relight(content.pop("lights"), content, interactive, world)
    if not interactive:
        _resting.pop(scene.session_uid, None)
    elif asked:
        _resting[scene.session_uid] = time.monotonic() + REST_SECONDS
    wake()


def content_of(scene: bpy.types.Scene, shot: shots.Shot) -> dict[str, Any]:
    """Content of a request for a scene's picture: its "lights", "gains", "world" and "static"."""
    lights = lights_of(scene, shot)
    mix = rows.mix(scene, [light["name"] for light in lights])
    world = [gain * factor for gain, factor in zip(mix["world"], shot.changes.world_gain(), strict=True)]
    return {"lights": lights, **mix, "world": world}


def lights_of(scene: bpy.types.Scene, shot: shots.Shot) -> list[Description]:
    """The present lights of a scene, as `SceneLights` describes them; reads at once what waits for that."""
    if _read_waiting(scene, shot, math.inf):
        changed(scene, interactive=True)
    return shot.lights.descriptions


def read_lights(scene: bpy.types.Scene) -> None:
    """Reads all lights of a scene anew and asks for their picture; where they are many, in turns."""
    shot, depsgraph = shots.of(scene), _depsgraph(scene)
    if shot is None or depsgraph is None:
        return
    if shot.lights.read(depsgraph, READ_SECONDS):
        changed(scene)
    wake()


def _read_waiting(scene: bpy.types.Scene, shot: shots.Shot, seconds: float) -> bool:
    """Continues reading lights for about that many seconds. Returns True if all are read now, and some may have
    changed."""
    if not shot.lights.is_waiting:
        return False
    # As it is: what has to be evaluated again will be named again.
    layer = scene.view_layers.get(shot.lights.view_layer)
    return layer is not None and layer.depsgraph is not None and shot.lights.go_on(layer.depsgraph, seconds)


def _depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The evaluated state of a scene that some window shows."""
    if bpy.context.scene == scene:
        return bpy.context.evaluated_depsgraph_get()
    return next((layer.depsgraph for layer in scene.view_layers if layer.depsgraph), None)


def wake() -> None:
    """Starts polling, or makes it quick again; it ends by itself when nothing runs."""
    global _is_quiet
    if bpy.app.background:
        return
    if not bpy.app.timers.is_registered(look_at_files):
        bpy.app.timers.register(look_at_files, first_interval=FILES_SECONDS, persistent=True)
    if bpy.app.timers.is_registered(_timer):
        if not _is_quiet:
            return
        bpy.app.timers.unregister(_timer)
    _is_quiet = False
    bpy.app.timers.register(_timer, persistent=True)


def _timer() -> float | None:
    global _is_quiet
    redraws.note_turn(QUIET_SECONDS if _is_quiet else TICK_SECONDS)
    _is_quiet = False
    if not tick():
        return None
    _is_quiet = not _resting and not any(_is_at_work(shot) for shot in shots.all_open())
    return QUIET_SECONDS if _is_quiet else TICK_SECONDS


def _is_at_work(shot: shots.Shot) -> bool:
    return shot.is_lively or shot.changes.is_pending or shot.lights.is_waiting


def look_at_files() -> float | None:
    """Checks if image files have changed since the bake; returns the seconds until the next check."""
    if any([shot.changes.mark_files() for shot in shots.all_open()]):
        wake()
    return FILES_SECONDS if shots.all_open() else None


def tick() -> bool:
    """Polls once; returns True if it is to be called again."""
    global _was_given
    scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
    _was_given = not _was_given and (rows.sync_due() or _begin_reading(scenes))
    if _was_given:
        return True
    _rest()
    goes_on = False
    for shot in shots.all_open():
        if shot.scene_uid not in scenes:
            shot.close()
            continue
        if shot.was_interrupted:  # Such as by undo. The bake before is whole still.
            shot.was_interrupted = False
            _open_stored(scenes[shot.scene_uid])
            goes_on = True
            continue
        if _read_waiting(scenes[shot.scene_uid], shot, READ_SECONDS):
            changed(scenes[shot.scene_uid], interactive=True)
        serial = shot.serial
        shot.poll()
        if not _resting and not _is_playing():
            shot.changes.update(scenes[shot.scene_uid], LOOK_SECONDS)
        if (world := shot.follow_world(scenes[shot.scene_uid])) is not None:
            changed(scenes[shot.scene_uid], world=world)
        if shot.lacks_a_kind and shot.folder not in folders_in_use(scenes[shot.scene_uid]):
            shot.learn_kinds()
        shot.show_passes(render_pass.wanted(scenes[shot.scene_uid]))
        goes_on |= redraws.follow(shot, new_picture=shot.serial != serial)
        goes_on |= shot.is_busy or shot.changes.is_pending or shot.lights.is_waiting
    return goes_on or bool(_resting) or rows.are_due()


def _begin_reading(scenes: dict[int, bpy.types.Scene]) -> bool:
    """Begins to read one of the scenes that are to be baked; returns True if there was one."""
    return any(shot.begin_reading(scenes[shot.scene_uid]) for shot in shots.all_open() if shot.scene_uid in scenes)


def _rest() -> None:
    """Asks for the full picture of every scene where nothing was changed for a while."""
    now = time.monotonic()
    for uid in _resting.keys() - {scene.session_uid for scene in bpy.data.scenes}:
        del _resting[uid]
    for scene in bpy.data.scenes:
        if _resting.get(scene.session_uid, now + 1.0) <= now:
            changed(scene)


def _is_playing() -> bool:
    """True while an animation is played, which needs the time itself."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)


@persistent
def on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Notices edits of the scene, and of its lights."""
    shot = shots.of(scene)
    if shot is None or depsgraph.mode != "VIEWPORT":
        return
    if scene.camera is not None:
        shot.recognises(scene.camera)
    lights = shot.lights.update(depsgraph, READ_SECONDS)
    world = shot.changes.mark(scene, list(depsgraph.updates))
    if lights or world:
        changed(scene, interactive=True)
    wake()


@persistent
def on_frame_change(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Notices that another frame is shown. Renders call this from a thread of their own."""
    shot = shots.of(scene)
    if shot is not None and not bpy.app.is_job_running("RENDER"):
        shot.changes.mark_frame()
        on_depsgraph_update(scene, depsgraph)


@persistent
def on_undo(*_arguments) -> None:
    """Undo and redo may have changed anything, in every scene."""
    global _was_given
    _was_given = True
    settle_settings()
    _remember_bakes()
    for shot in shots.all_open():
        shot.changes.mark_all()
        shot.lights.forget()
    if bpy.app.background:
        read_forgotten()
    elif not bpy.app.timers.is_registered(read_forgotten):  # As a rule an update comes before.
        bpy.app.timers.register(read_forgotten, first_interval=QUIET_SECONDS)


def read_forgotten() -> None:
    """Reads lights anew where no update of their scene has had them read since undo, and asks for what has become of
    the rows."""
    # What no window shows is not evaluated again before it is shown; its old state may hold what undo has freed.
    for scene in {window.scene for window in bpy.context.window_manager.windows}:
        shot = shots.of(scene)
        if shot is not None and shot.lights.is_forgotten:
            read_lights(scene)
        elif shot is not None and not shot.lights.is_waiting:
            changed(scene)


@persistent
def on_save_pre(*_arguments) -> None:
    """The file is about to be written."""
    show_settings()
    _remember_bakes()
    for scene in bpy.data.scenes:
        shot = shots.of(scene)
        if shot is not None and scene.camera is not None and shot.recognises(scene.camera):
            shot.keep_record()


def _remember_bakes() -> None:
    """Restores the locations of bakes, which must not go back with undo."""
    for scene in bpy.data.scenes:
        shot = shots.of(scene)
        if shot is not None and shot.is_stored and remembered_bake(scene) != shot.folder:
            remember_bake(scene, shot.folder)


@persistent
def on_save_post(*_arguments) -> None:
    """The file was written, or could not be."""
    settle_settings()


@persistent
def on_load_pre(*_arguments) -> None:
    """Closes all shots before another file is opened."""
    close_all()


@persistent
def on_load_post(*_arguments) -> None:
    """A file was opened, or could not be and the one before stays. Its bakes are opened a moment later, when it is on
    screen."""
    settle_settings()
    chosen = preferences()
    if not bpy.app.background and chosen is not None and chosen.open_bakes:
        bpy.app.timers.register(open_bakes, first_interval=0.1)


def open_bakes() -> None:
    """Opens every bake that the file remembers, or that was made in the background after it was closed."""
    for scene in bpy.data.scenes:
        if shots.of(scene) is None:
            _open_stored(scene)


def _open_stored(scene: bpy.types.Scene) -> None:
    """Shows the stored bake of a scene, if there is one; the panel says why not."""
    _unopened.pop(scene.session_uid, None)
    try:
        if is_bake(remembered_bake(scene) or bake_folder(scene)):
            open_bake(scene)
    except (NativeModuleError, RuntimeError, FolderError) as error:
        _unopened[scene.session_uid] = f"The bake of this scene could not be opened: {' '.join(str(error).split())}"
        redraw("UI")


def why_not_open(scene: bpy.types.Scene) -> str:
    """Why the stored bake of a scene was not shown when its file was opened; empty if nothing went wrong."""
    return _unopened.get(scene.session_uid, "")


def open_bake(scene: bpy.types.Scene) -> shots.Shot:
    """Shows the bake of a scene under its present lights."""
    shot = shots.Shot.open(scene)
    read_lights(scene)
    wake()
    return shot


def close_all(wait_seconds: float = 0.0) -> None:
    """Ends all work."""
    shots.close_all(wait_seconds)
    _resting.clear()
    _unopened.clear()
    redraws.forget()


def _exit() -> None:
    """Threads must not outlive the libraries that they use."""
    close_all(EXIT_SECONDS)


HANDLERS = {
    "depsgraph_update_post": on_depsgraph_update,
    "frame_change_post": on_frame_change,
    "undo_post": on_undo,
    "redo_post": on_undo,
    "save_pre": on_save_pre,
    "save_post": on_save_post,
    "save_post_fail": on_save_post,
    "load_pre": on_load_pre,
    "load_post": on_load_post,
    "load_post_fail": on_load_post,
}


def register():
    """Adds the handlers."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    atexit.register(_exit)


def unregister():
    """Ends all work and removes handlers and timer."""
    close_all()
    atexit.unregister(_exit)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    for timer in (_timer, look_at_files, open_bakes, read_forgotten):
        if bpy.app.timers.is_registered(timer):
            bpy.app.timers.unregister(timer)
