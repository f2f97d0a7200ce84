"""Scheduler of all open shots: requests for pictures, and the one timer that polls.

An edit asks for a quick picture at once. The full one is asked for when nothing has changed for `DEBOUNCE_SECONDS`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import bpy

from ..core.phase import ShotPhase
from ..engine.reading.scene_lights import Description
from ..engine.shot import open_shots
from ..engine.shot import shot as shots
from ..engine.shot.checks import folders_in_use
from ..viewport import views
from . import opening, rows, seen
from .redraws import Redraws

TICK_SECONDS = 1 / 60
IDLE_SECONDS = 0.25
"""Seconds between ticks while nothing new comes, such as while work is paused."""
DEBOUNCE_SECONDS = 0.15
FILES_SECONDS = 2.0
"""Seconds between checks of image files."""
STALENESS_SECONDS = 0.005
"""Seconds in one tick for finding what has changed since the bake."""


class Scheduler:
    """Timer, debouncing and requests of all open shots."""

    def __init__(self) -> None:
        self.settling: dict[int, float] = {}
        """Time at which to ask for the full picture, by the uid of each scene with a change in progress."""
        self.read_seconds = math.inf if bpy.app.background else 0.01
        """Seconds in one tick for reading lights: without a window there are no ticks."""
        self._deferred: dict[Callable[[], object], float] = {}
        """Times of work that was put off."""
        self._files_due = 0.0
        self._is_awake = self._is_running = False
        self._skips_exclusive = False
        """True if the previous tick did exclusive work, or undo has just had lights read. Two such ticks never follow
        each other, so that dragging stays responsive."""
        self._interval = self._next = 0.0
        self.redraws = Redraws()
        self._timer = self._on_timer  # Blender knows a timer by the object.

    def request_picture(self, scene: bpy.types.Scene, interactive: bool = False) -> None:
        """Asks for pictures of the present lights and rows of a scene, in all its open shots that are seen. To be
        called by everything that changes them; `interactive` while something is being dragged."""
        found = open_shots.all_of(scene)
        if not found:
            return
        is_new = [self._ask(scene, shot, interactive) for shot in found if shot.is_seen or not interactive]
        if not interactive:
            self.settling.pop(scene.session_uid, None)
        elif any(is_new):
            self.settling[scene.session_uid] = time.monotonic() + DEBOUNCE_SECONDS
        self.wake()

    def _ask(self, scene: bpy.types.Scene, shot: shots.Shot, interactive: bool, world: Any = None) -> bool:
        """Asks for the picture of one shot; `world` is as `Shot.relight` takes it. True if that is a new one."""
        content = self.content_of(scene, shot)
        return shot.relight(content.pop("lights"), content, interactive, world)

    def content_of(self, scene: bpy.types.Scene, shot: shots.Shot, key: str | None = None) -> dict[str, Any]:
        """Content of a request for a scene's picture: its "lights", "gains", "world" and "static". Rows are as in the
        shot of a key; by default as in the one whose lights these are."""
        lights = self.lights_of(scene, shot)
        mix = rows.mix(scene, [light["name"] for light in lights], shot.key if key is None else key)
        world = [gain * factor for gain, factor in zip(mix["world"], shot.changes.world_gain(), strict=True)]
        return {"lights": lights, **mix, "world": world}

    def lights_of(self, scene: bpy.types.Scene, shot: shots.Shot) -> list[Description]:
        """The present lights of a scene, as `SceneLights` describes them; reads at once what waits for that."""
        if _read_waiting(scene, shot, math.inf):
            self.request_picture(scene, interactive=True)
        return shot.lights.descriptions

    def read_lights(self, scene: bpy.types.Scene) -> None:
        """Reads all lights of a scene anew and asks for their picture; where they are many, in several ticks."""
        found, depsgraph = open_shots.lights_of(scene), _depsgraph(scene)
        if not found:
            return
        if depsgraph is not None and all([lights.read(depsgraph, self.read_seconds) for lights in found]):
            self.request_picture(scene)
        self.wake()

    def wake(self) -> None:
        """Starts to tick, or does it more often again; ticks end by themselves when nothing is left to do."""
        self._is_awake = True
        now = time.monotonic()
        self._files_due = self._files_due or now + FILES_SECONDS
        self._run_at(now, TICK_SECONDS)

    def defer(self, work: Callable[[], object], seconds: float) -> None:
        """Puts work off, in a window. It is done once, however often it was put off."""
        when = self._deferred.setdefault(work, time.monotonic() + seconds)
        self._run_at(when)

    def skip_exclusive(self) -> None:
        """Keeps the next tick from exclusive work."""
        self._skips_exclusive = True

    def _run_at(self, when: float, tolerance: float = 0.0) -> None:
        if bpy.app.background or self._is_running:
            return
        if bpy.app.timers.is_registered(self._timer):
            if self._next <= when + tolerance:
                return
            bpy.app.timers.unregister(self._timer)
        self._interval, self._next = max(when - time.monotonic(), 0.0), when
        bpy.app.timers.register(self._timer, first_interval=self._interval, persistent=True)

    def _on_timer(self) -> float | None:
        self.redraws.note_tick(self._interval)
        self._is_running = True
        try:
            self._do_deferred()
            self._is_awake |= self._files_are_due() and self.look_at_files()
            self._is_awake = self._is_awake and self.tick()
        finally:
            self._is_running = False
        now = time.monotonic()
        if self._is_awake:
            is_idle = not self.settling and not any(_is_at_work(shot) for shot in shots.all_open())
            self._next = now + (IDLE_SECONDS if is_idle else TICK_SECONDS)
        else:
            self._next = min([*self._deferred.values(), *[self._files_due] * bool(self._files_due)], default=math.inf)
        self._interval = max(self._next - now, 0.0)
        return self._interval if self._interval < math.inf else None

    def _do_deferred(self) -> None:
        now = time.monotonic()
        for work in [work for work, when in self._deferred.items() if when <= now]:
            del self._deferred[work]
            work()

    def _files_are_due(self) -> bool:
        now = time.monotonic()
        if not 0.0 < self._files_due <= now:
            return False
        self._files_due = now + FILES_SECONDS if shots.all_open() else 0.0
        return True

    def look_at_files(self) -> bool:
        """Has image files compared with those of the bake; returns True if there are any."""
        return any([shot.changes.mark_files() for shot in shots.all_open()])

    def tick(self) -> bool:
        """Polls once; returns True if it is to be called again."""
        scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
        self._skips_exclusive = not self._skips_exclusive and (rows.sync_due() or _begin_reading(scenes))
        if self._skips_exclusive:
            return True
        self._settle()
        goes_on = False
        for scene in scenes.values():
            if seen.follow(scene):
                self.read_lights(scene)
                goes_on = True
        for shot in shots.all_open():
            if shot.scene_uid in scenes:
                goes_on |= self._poll(scenes[shot.scene_uid], shot)
            else:
                shot.close()
        return goes_on or bool(self.settling) or rows.are_due()

    def _poll(self, scene: bpy.types.Scene, shot: shots.Shot) -> bool:
        """Polls a shot; returns True if more is to be expected of it."""
        if shot.phase is ShotPhase.INTERRUPTED:  # Such as by undo. The bake before is whole still.
            shot.give_up_reading()
            if opening.open_stored(scene):
                self.read_lights(scene)
            return True
        if _read_waiting(scene, shot, self.read_seconds):
            self.request_picture(scene, interactive=True)
        serial = shot.serial
        shot.poll()
        if not self.settling and not _is_playing():
            shot.changes.update(scene, STALENESS_SECONDS / len(open_shots.all_of(scene)))
        if (world := shot.follow_world(scene)) is not None:
            self._ask(scene, shot, False, world)
        if shot.lacks_a_kind and shot.folder not in folders_in_use(scene):
            shot.learn_kinds()
        shot.show_passes(views.passes_of(scene, shot))
        goes_on = self.redraws.follow(scene, shot, new_picture=shot.serial != serial)
        return goes_on or shot.is_busy or shot.changes.is_pending or shot.lights.is_waiting

    def _settle(self) -> None:
        """Asks for the full picture of every scene where nothing was changed for a while."""
        now = time.monotonic()
        for uid in self.settling.keys() - {scene.session_uid for scene in bpy.data.scenes}:
            del self.settling[uid]
        for scene in bpy.data.scenes:
            if self.settling.get(scene.session_uid, now + 1.0) <= now:
                self.request_picture(scene)

    def close_all(self, wait_seconds: float = 0.0) -> None:
        """Closes all shots and ends the timer."""
        shots.close_all(wait_seconds)
        self.settling.clear()
        self._deferred.clear()
        self._is_awake, self._files_due = False, 0.0
        self.redraws = Redraws()
        opening.forget()
        seen.forget()
        if bpy.app.timers.is_registered(self._timer) and not self._is_running:
            bpy.app.timers.unregister(self._timer)


scheduler = Scheduler()


def _read_waiting(scene: bpy.types.Scene, shot: shots.Shot, seconds: float) -> bool:
    """Continues reading lights for about that many seconds. Returns True if all are read now, and some may have
    changed."""
    if not shot.lights.is_waiting:
        return False
    # The depsgraph is read as it is: whatever has to be evaluated again will be named again.
    layer = scene.view_layers.get(shot.lights.view_layer)
    return layer is not None and layer.depsgraph is not None and shot.lights.go_on(layer.depsgraph, seconds)


def _depsgraph(scene: bpy.types.Scene) -> bpy.types.Depsgraph | None:
    """The evaluated state of a scene that some window shows."""
    if bpy.context.scene == scene:
        return bpy.context.evaluated_depsgraph_get()
    return next((layer.depsgraph for layer in scene.view_layers if layer.depsgraph), None)


def _begin_reading(scenes: dict[int, bpy.types.Scene]) -> bool:
    """Begins to read one of the scenes that are to be baked; returns True if there was one."""
    return any(shot.begin_reading(scenes[shot.scene_uid]) for shot in shots.all_open() if shot.scene_uid in scenes)


def _is_at_work(shot: shots.Shot) -> bool:
    return shot.is_lively or shot.changes.is_pending or shot.lights.is_waiting


def _is_playing() -> bool:
    """True while an animation is played, which needs the time itself."""
    return any(window.screen.is_animation_playing for window in bpy.context.window_manager.windows)
