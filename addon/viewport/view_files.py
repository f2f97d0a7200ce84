"""Keeps the view beside an open bake (`export.view_file`) that of its scene, a slice at a time and once the artist has
let it be for a moment: dragging exposure writes nothing."""

from __future__ import annotations

import time
from collections.abc import Iterator
from weakref import WeakKeyDictionary

import bpy

from ..engine.shot import Shot
from ..export.view_file import is_current, view_table_slices
from ..export.view_transform import view_key

FILE = "view.png"
SETTLE_SECONDS = 1.0
NEXT_SLICE_SECONDS = 0.005

_done: WeakKeyDictionary[Shot, tuple] = WeakKeyDictionary()
"""The view that was written, or cannot be."""
_seen: WeakKeyDictionary[Shot, tuple[tuple, float]] = WeakKeyDictionary()
"""The view that was seen last, and since when."""
_making: WeakKeyDictionary[Shot, Iterator[None]] = WeakKeyDictionary()


def is_done(found: Shot, scene: bpy.types.Scene) -> bool:
    """Whether there is nothing left to do for `work`."""
    has_bake = found.is_stored and found.status["samples"] > 0
    return not has_bake or _done.get(found) == view_key(scene)


def work(found: Shot, scene: bpy.types.Scene) -> float:
    """Colours one slice of the file; seconds until the next turn. Not while drawing."""
    key, now = view_key(scene), time.monotonic()
    before, since = _seen.get(found, ((), now))
    if key != before:
        _seen[found] = key, now
        _making.pop(found, None)
        return SETTLE_SECONDS
    if now - since < SETTLE_SECONDS:
        return SETTLE_SECONDS
    path = found.folder / FILE
    try:
        if found not in _making:
            _making[found] = iter(()) if is_current(scene, path) else view_table_slices(scene, path)
        next(_making[found])
        return NEXT_SLICE_SECONDS
    except StopIteration:
        pass
    except ReferenceError:  # Undo has made another scene of it: the next turn begins again.
        return _forget(found)
    except OSError as error:
        found.warnings.append(f"PNGs that the command line makes of this bake will not have the scene's view: {error}")
    _done[found] = key
    return _forget(found)


def _forget(found: Shot) -> float:
    _making.pop(found, None)
    return NEXT_SLICE_SECONDS
