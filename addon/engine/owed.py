"""What the bake folder of a shot still lacks of what was asked for, or of what came into use later."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..core import wanted
from ..core.forecast import Forecast
from .options import Options


class Owed:
    """Of one shot. It is written into the folder (`core.wanted`), so that it is known still after Blender has died."""

    def __init__(self, options: Options):
        self.folder: Path = options.folder
        self.wanted: wanted.Wanted | None = None
        """What the folder still lacks something of."""
        self._options = options
        self._is_asked_for = False
        """Whether this shot was baked, and not opened alone."""
        self._forecast = Forecast(options.train_seconds)
        self._taken_up: set[str] = set()
        """Kinds of light that were learned after all else was done, or were to be."""

    def read(self) -> None:
        """Takes what the folder says, of a bake that is opened."""
        self.wanted = wanted.read(self.folder)

    def note_bake(self) -> None:
        """A bake begins."""
        self._is_asked_for = True
        self._write(self._options.samples)

    def _write(self, samples: int) -> None:
        self.wanted = wanted.Wanted(samples, self._options.train_seconds)
        self.wanted.write(self.folder)

    def note(self, status: dict[str, Any]) -> None:
        """Takes a new status, and tells in it what is owed and how long that will take."""
        if self._is_asked_for and status["state"] == "ready":
            wanted.forget(self.folder)
            self.wanted = None
        status["is_owed"] = self.wanted is not None
        if self.wanted is not None:
            status["samples_total"] = max(status["samples_total"], self.wanted.samples)
        self._forecast.note(status)
        status["rest"] = self._forecast.rest(status)
        if status["stage"] is not None:  # Before it has compared, the native module counts the time limit alone.
            status["stage"]["remaining_s"] = self._forecast.of_stage(status)

    def lacks_a_kind(self, status: dict[str, Any]) -> bool:
        """Whether a kind of light came into use after all was done that was asked for, and could be learned as well."""
        is_done = self._is_asked_for and status["state"] == "ready" and self.wanted is None
        may_learn = is_done and self._options.train_seconds > 0.0
        return may_learn and not self._taken_up.issuperset(status["unlearned"])

    def note_kinds(self, status: dict[str, Any]) -> float:
        """The kinds of light that the bake lacks are about to be learned, each for so many seconds."""
        self._taken_up |= set(status["unlearned"])
        self._write(status["samples_total"])
        return self._options.train_seconds
