"""Writes the view of a scene beside its open bake (`export.view_file`), a moment after the last edit: dragging exposure
writes nothing."""

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
"""Keys of the views that were written, or cannot be."""
_last_views: WeakKeyDictionary[Shot, tuple[str, float]] = WeakKeyDictionary()
"""Key of the last view of each shot, and the time since when it holds."""


def is_done(shot: Shot, scene: bpy.types.Scene) -> bool:
    """True if nothing is left to do for `work`."""
    has_bake = shot.is_stored and shot.status["samples"] > 0
    return not has_bake or _done.get(shot) == view_key(scene)


def work(shot: Shot, scene: bpy.types.Scene) -> float:
    """Polls the writing of the file; returns the seconds until the next call."""
    key, now = view_key(scene), time.monotonic()
    before, since = _last_views.get(shot, ("", now))
    if key != before:
        _last_views[shot] = key, now
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
