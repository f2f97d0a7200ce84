"""When the 3D views are drawn again: for a new picture at once, for new words as often as drawing is cheap.

To show one region anew Blender puts its whole window together again, which takes time that tracing could use.
"""

from __future__ import annotations

import time

import bpy

from ..core import status
from ..engine.shot import open_shots
from ..engine.shot.shot import Shot
from ..viewport import views
from ..viewport.side_bar import characters, lines

SHARE = 0.1
"""Largest share of the time for redraws that show progress only."""
PAUSE_SECONDS = 0.1
"""Seconds between drawings of progress where they cost nothing."""


class Redraws:
    """Redraws of the 3D views, and what their side bars say."""

    def __init__(self) -> None:
        self._said: dict[int, tuple[tuple, tuple]] = {}
        """By scene, the words that must be read at once, with how many lines there are, and progress."""
        self._settling: set[int] = set()
        """Scenes whose side bar has other lines now: Blender puts the panels below in their places one drawing
        later."""
        self._asked: float | None = None
        """Time at which progress was last asked to be drawn, until that is done."""
        self._due = 0.0
        """Time at which progress may be drawn again."""

    def note_tick(self, interval: float) -> None:
        """To be called first in each tick of a timer, which is `interval` seconds after the one before unless Blender
        was drawing."""
        if self._asked is not None:
            took = time.perf_counter() - self._asked - interval
            self._asked, self._due = None, time.perf_counter() + max(took / SHARE, PAUSE_SECONDS)

    def follow(self, scene: bpy.types.Scene, shot: Shot, new_picture: bool) -> bool:
        """Has drawn again what a shot has made old; returns True if some of that is still to be done. Side bars speak
        of the current shot."""
        if new_picture and open_shots.beside(scene):
            views.redraw_shot(scene, shot)
        if open_shots.of(scene) is not shot:
            return False
        uid, says = shot.scene_uid, _words(shot)
        urgent, before = says[0], self._said.get(uid, ((), ()))
        if new_picture:
            views.redraw(*(["UI"] if open_shots.beside(scene) else ["WINDOW", "UI"]))
        elif urgent != before[0] or uid in self._settling:
            views.redraw("UI")
        elif says == before:
            return False
        elif time.perf_counter() < self._due:
            return True
        else:
            self._asked = time.perf_counter()
            views.redraw("UI")
        self._said[uid] = says
        (self._settling.add if urgent != before[0] else self._settling.discard)(uid)
        return uid in self._settling


def _words(shot: Shot) -> tuple[tuple, tuple]:
    state, progress, to_come = shot.status, status.progress(shot.status), status.to_come(shot.status)
    words = status.headline(state), to_come, status.shown(state)
    urgent = (
        *(state.phase, state.live.paused, state.error, progress is None, to_come == "", len(shot.notes)),
        *((state.live.shown or {}).get("scale"), *shot.changes.sentences),
        *(len(lines(text, characters(bar))) for bar in views.regions("UI") for text in words),
    )
    return urgent, (*words, progress)
