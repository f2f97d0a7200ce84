"""Reading of a scene's target picture, which goes on while Blender's window does."""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from ...core.bake_folder import size_of
from ...core.solve import SolveError
from ..shot import shot as shots
from ..workers.pictures import Read, Reading, is_in_memory

POLL_SECONDS = 0.05


def picture_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height that targets and masks are scaled to: those of the bake, or else of a render."""
    shot, render = shots.of(scene), scene.render
    size = size_of(shot.folder) if shot is not None else None
    if size is not None:
        return size
    share = render.resolution_percentage / 100.0
    return max(round(render.resolution_x * share), 1), max(round(render.resolution_y * share), 1)


@dataclass(frozen=True)
class _KeptReading:
    key: tuple
    """Values that the pixels depend on, as of `_key`."""
    reading: Reading


_readings: dict[int, _KeptReading] = {}
"""Readings by the session uid of their scene."""
listeners: list[Callable[[], None]] = []
"""Functions that are called when a reading has ended."""


def read(scene: bpy.types.Scene) -> None:
    """Begins to read the scene's target, to tell if it can be one."""
    forget(scene.session_uid)
    settings = scene.relume_solve
    if settings.target is None:
        return
    size = picture_size(scene)
    reading = Reading(scene, settings.target, size, settings.target_colors)
    _readings[scene.session_uid] = _KeptReading(_key(scene, size), reading)
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, first_interval=0.0)


def reading_of(scene: bpy.types.Scene) -> Reading | None:
    """Reading of the scene's present target, which may have ended; None if there is none."""
    kept, image = _readings.get(scene.session_uid), scene.relume_solve.target
    return kept.reading if kept and image is not None and kept.key[0] == image.session_uid else None


def awaited(scene: bpy.types.Scene) -> Generator[None, None, Read]:
    """Yields until the scene's target is read; anew, if it may be another picture by now. Raises SolveError."""
    kept, image = _readings.get(scene.session_uid), scene.relume_solve.target
    if kept is None or (kept.reading.is_done and is_in_memory(image)) or kept.key != _key(scene, picture_size(scene)):
        read(scene)
    reading = _readings[scene.session_uid].reading
    while reading.step():
        yield
    if reading.found is None:
        raise SolveError(reading.error or "The target became another one while it was read: solve again")
    return reading.found


def forget(uid: int) -> None:
    """Forgets the target of a scene, and ends reading it."""
    kept = _readings.pop(uid, None)
    if kept is not None:
        kept.reading.close()


def _key(scene: bpy.types.Scene, size: tuple[int, int]) -> tuple:
    """All that the light of a target depends on, apart from pixels that were painted."""
    image, view = scene.relume_solve.target, scene.view_settings
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    changed = path.stat().st_mtime_ns if path.is_file() else 0
    displayed = (view.view_transform, view.look, view.exposure, view.gamma, view.use_curve_mapping)
    return image.session_uid, path, changed, scene.relume_solve.target_colors, size, displayed


def _timer() -> float | None:
    """Continues all readings; returns the seconds until the next call."""
    goes_on = False
    for kept in _readings.values():
        if not kept.reading.is_done:
            goes_on |= kept.reading.step()
            if kept.reading.is_done:
                for listener in listeners:
                    listener()
    return POLL_SECONDS if goes_on else None


@persistent
def forget_all(*_arguments) -> None:
    """Forgets all targets: another file is about to be opened, or the add-on is disabled."""
    for uid in list(_readings):
        forget(uid)
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
