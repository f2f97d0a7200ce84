"""When the 3D views are drawn again: for a new picture at once, for new words as often as drawing is cheap.

To show one region anew Blender puts its whole window together again, which takes time that tracing could use.
"""

from __future__ import annotations

import time

from ..core import status
from ..engine.shot.shot import Shot
from ..viewport import views
from .panel import characters, lines

SHARE = 0.1
"""Largest share of the time for redraws that show progress only."""
PAUSE_SECONDS = 0.1
"""Between drawings of progress where they cost nothing."""

_said: dict[int, tuple[tuple, tuple]] = {}
"""By scene, what the side bar says: words that must be read at once, with how many lines there are, and progress."""
_settling: set[int] = set()
"""Scenes whose side bar has other lines now: Blender puts the panels below in their places one drawing later."""
_asked: float | None = None
_due = 0.0
"""When progress was last asked to be drawn, until that is done; and when it may be again."""


def note_turn(interval: float) -> None:
    """To be called first in each turn of a timer, which is `interval` seconds after the one before unless Blender was
    drawing."""
    global _asked, _due
    if _asked is not None:
        took = time.perf_counter() - _asked - interval
        _asked, _due = None, time.perf_counter() + max(took / SHARE, PAUSE_SECONDS)


def follow(shot: Shot, new_picture: bool) -> bool:
    """Has drawn again what a shot has made old. Whether that is not done yet."""
    global _asked
    uid, says = shot.scene_uid, _words(shot)
    urgent, before = says[0], _said.get(uid, ((), ()))
    if new_picture:
        views.redraw("WINDOW", "UI")
    elif urgent != before[0] or uid in _settling:
        views.redraw("UI")
    elif says == before:
        return False
    elif time.perf_counter() < _due:
        return True
    else:
        _asked = time.perf_counter()
        views.redraw("UI")
    _said[uid] = says
    (_settling.add if urgent != before[0] else _settling.discard)(uid)
    return uid in _settling


def forget() -> None:
    """Nothing is shown any more."""
    global _asked, _due
    _said.clear()
    _settling.clear()
    _asked, _due = None, 0.0


def _words(shot: Shot) -> tuple[tuple, tuple]:
    state, progress, to_come = shot.status, status.progress(shot.status), status.to_come(shot.status)
    urgent = (state["state"], state["paused"], state["error"], progress is None, to_come == "", len(shot.notes))
    urgent += ((state["shown"] or {}).get("scale"), *shot.changes.sentences)
    words = status.headline(state), to_come, status.shown(state)
    urgent += tuple(len(lines(text, characters(bar))) for bar in views.regions("UI") for text in words)
    return urgent, (*words, progress)
