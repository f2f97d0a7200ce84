"""Shows two looks beside each other: asks for the picture of each, one after the other, and hands both to the overlay.
Afterwards the picture of the present lights is asked for again."""

from __future__ import annotations

import json
from typing import Any

import bpy
from bpy.app.handlers import persistent

from ..core.looks import rows_in
from ..core.receivers import with_numbers
from ..core.rows import mix_for
from ..core.status import is_final
from ..engine.shot import requests
from ..engine.shot import shot as shots
from ..export.current_shot import entries
from ..viewport import compare
from . import rows
from .scheduler import scheduler

STEP_SECONDS = 1 / 30

_running: dict[int, Comparison] = {}


class CompareError(Exception):
    """The looks cannot be compared; the message is one line for the artist."""


class Comparison:
    """Collects the frames of one or two looks."""

    def __init__(self, scene: bpy.types.Scene, looks: list[Any]):
        shot = shots.of(scene)
        if shot is None:
            raise CompareError("press Start first: looks are compared in the picture of a bake")
        if shot.frame is None:
            raise CompareError("wait for the first picture")
        self.shot = shot
        self.labels = (looks[0].name, looks[1].name if len(looks) > 1 else "Now")
        self.requests = [request_of(scene, shot, look) for look in looks]
        self.frames: list[Any] = []
        self.number = 0
        self._ask()

    def _ask(self) -> None:
        self.number = self.shot.ask(requests.kept_request(self.requests[len(self.frames)]))
        scheduler.wake()

    def step(self) -> bool:
        """Advances by one step; returns True if it is to be called again."""
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == self.shot.scene_uid), None)
        if scene is None or not self.shot.is_open or not self.shot.can_show:
            return False
        frame = self.shot.frame
        if frame is None or frame.request < self.number:
            return True
        if frame.request == self.number and not is_final(frame):
            return True
        if frame.request == self.number:
            self.frames.append(frame)
        if len(self.frames) < len(self.requests):  # The next one, or the same again if a newer request won.
            self._ask()
            return True
        first, second = [*self.frames, None][:2]
        compare.set_pair(scene, first, second, scene.relume_view.compare, self.labels)
        scheduler.request_picture(scene)
        return False


def start(scene: bpy.types.Scene, looks: list[Any]) -> Comparison:
    """Begins to compare two looks, or one with the present picture. Raises CompareError or LookError."""
    comparison = _running[scene.session_uid] = Comparison(scene, looks)
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer)
    return comparison


def running(scene: bpy.types.Scene) -> Comparison | None:
    """The comparison whose pictures are being waited for."""
    return _running.get(scene.session_uid)


def stop(scene: bpy.types.Scene) -> None:
    """Ends a comparison and shows the live picture alone."""
    _running.pop(scene.session_uid, None)
    compare.clear(scene)
    scheduler.request_picture(scene)


def request_of(scene: bpy.types.Scene, shot: shots.Shot, look: Any) -> str:
    """Request for the picture of a look, as it was when the look was made; without one, as for an imported look, its
    rows with the present lights."""
    if look.request:
        request = json.dumps(json.loads(look.request) | {"interactive": False})
        return with_numbers(request, shot.lights.receivers)
    lights = scheduler.lights_of(scene, shot)
    present, groups, memberships = rows.plain(scene)
    entry = next((entry for entry in entries(scene) if entry.key == shot.key), None)
    values = rows_in(look.look(), entry.name if entry is not None else "", [*present, *groups])
    names = [light["name"] for light in lights]
    mix = mix_for(names, values[: len(present)], values[len(present) :], memberships)
    return requests.request_text({"lights": lights, **mix})


def _timer() -> float | None:
    for uid, comparison in list(_running.items()):
        if not comparison.step():
            del _running[uid]
    return STEP_SECONDS if _running else None


@persistent
def on_load_pre(*_arguments) -> None:
    """Another file is about to be opened."""
    _running.clear()
    compare.free()


def register():
    """Ends comparisons with their file."""
    bpy.app.handlers.load_pre.append(on_load_pre)


def unregister():
    """Ends comparisons."""
    bpy.app.handlers.load_pre.remove(on_load_pre)
    on_load_pre()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
