"""Keeps the view beside an open bake (`export.view_file`) that of its scene, once the artist has let it be for a
moment: dragging exposure writes nothing."""

from __future__ import annotations

import time
from weakref import WeakKeyDictionary

import bpy

from ..engine.shot.shot import Shot
from ..engine.workers import view_worker
from ..export.view_file import is_current, stamp
from ..export.view_transform import view_key, view_settings

FILE = "view.png"
SETTLE_SECONDS = 1.0
NEXT_TURN_SECONDS = 0.03

_done: WeakKeyDictionary[Shot, str] = WeakKeyDictionary()
"""The view that was written, or cannot be."""
_seen: WeakKeyDictionary[Shot, tuple[str, float]] = WeakKeyDictionary()
"""The view that was seen last, and since when."""


def is_done(shot: Shot, scene: bpy.types.Scene) -> bool:
    """True if nothing is left to do for `work`."""
    has_bake = shot.is_stored and shot.status["samples"] > 0
    return not has_bake or _done.get(shot) == view_key(scene)


def work(shot: Shot, scene: bpy.types.Scene) -> float:
    """A turn of having the file written; seconds until the next one."""
    key, now = view_key(scene), time.monotonic()
    before, since = _seen.get(shot, ("", now))
    if key != before:
        _seen[shot] = key, now
        return SETTLE_SECONDS
    if now - since < SETTLE_SECONDS:
        return SETTLE_SECONDS
    path = shot.folder / FILE
    try:
        if is_current(scene, path):
            _done[shot] = key
        else:
            worker = view_worker.shared()
            worker.ask(view_worker.file_of(view_settings(scene), path, stamp(scene)))
            worker.turn()
    except OSError as error:
        shot.warnings.append(f"PNGs that the command line makes of this bake will not have the scene's view: {error}")
        _done[shot] = key
    return NEXT_TURN_SECONDS
