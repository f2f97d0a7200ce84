"""Work that the bake folder of a shot still lacks to meet its goal, and light types that came into use later."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ...core import bake_goal
from ...core.eta import EtaEstimator
from .options import Options


class RemainingWork:
    """Remaining work of one shot. Its goal is written into the folder, so it is known after Blender has died."""

    def __init__(self, options: Options):
        self.folder: Path = options.folder
        self.goal: bake_goal.BakeGoal | None = None
        """Goal that the folder does not meet yet; None if the bake is whole."""
        self._options = options
        self._has_begun = False
        """True if this shot was baked, and not only opened."""
        self._eta = EtaEstimator(options.train_seconds)
        self._learned_later: set[str] = set()
        """Kinds of light that were learned, or asked for, after the goal was met."""

    def read(self) -> None:
        """Reads the goal of a bake that is opened."""
        self.goal = bake_goal.read(self.folder)

    def note_bake(self) -> None:
        """Sets the goal of a bake that begins."""
        self._has_begun = True
        self._write(self._options.samples)

    def _write(self, samples: int) -> None:
        self.goal = bake_goal.BakeGoal(samples, self._options.train_seconds)
        self.goal.write(self.folder)

    def note(self, status: dict[str, Any]) -> None:
        """Takes a new status, and adds to it what remains and how long that will take."""
        if self._has_begun and status["state"] == "ready":
            bake_goal.forget(self.folder)
            self.goal = None
        status["is_incomplete"] = self.goal is not None
        if self.goal is not None:
            status["samples_total"] = max(status["samples_total"], self.goal.samples)
        self._eta.note(status)
        status["remaining"] = self._eta.remaining(status)
        if status["stage"] is not None:  # Before it has compared, the native module counts the time limit alone.
            status["stage"]["remaining_s"] = self._eta.stage_remaining(status)

    def lacks_a_kind(self, status: dict[str, Any]) -> bool:
        """True if a kind of light came into use after the goal was met, and could be learned as well."""
        is_done = self._has_begun and status["state"] == "ready" and self.goal is None
        may_learn = is_done and self._options.train_seconds > 0.0
        return may_learn and not self._learned_later.issuperset(status["unlearned"])

    def note_kinds(self, status: dict[str, Any]) -> float:
        """Sets the goal to learn the kinds of light that the bake lacks; returns the seconds for each."""
        self._learned_later |= set(status["unlearned"])
        self._write(status["samples_total"])
        return self._options.train_seconds
