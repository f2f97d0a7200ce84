"""How long all that is left of a bake will take, tracing and learning, by the paces so far."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

COMPARED = 0.2
"""Share of learning by which the native module knows for sure how long comparing takes: it does so at every tenth,
beside the time limit."""
Part: TypeAlias = tuple[float, bool]
"""Seconds that something takes, and whether it takes no longer."""
UNKNOWN: Part = (0.0, False)


class Rest(NamedTuple):
    """All that is left, where something follows the present stage."""

    seconds: float
    is_whole: bool
    """Whether the pace of everything is known; otherwise it will take longer."""
    traces: bool
    """Whether paths are among it."""


class Forecast:
    """Of one bake. `note` is to be told every status before `rest` is asked about it."""

    def __init__(self, train_seconds: float) -> None:
        self._limit = train_seconds
        self._training: Part = (train_seconds, False)
        """Of each kind of light, with comparing on the way."""
        self._tracing: float | None = None
        """Seconds for one more path per pixel."""
        self._references = _Seen()
        """Pictures to compare with."""
        self._measuring = _Seen()
        """Measuring what was learned."""

    def note(self, status: dict[str, Any]) -> None:
        """Takes the pace of the present stage."""
        stage = status["stage"]
        if stage is None or stage["remaining_s"] is None:
            return
        left, elapsed = stage["remaining_s"], stage["elapsed_s"]
        match stage["stage"]:
            case "trace" if (share := _share(stage)) < 1.0:
                self._tracing = left / ((1.0 - share) * status["samples_total"])
            case "references":
                self._references = _Seen(status["samples"], elapsed + left)
            case "train" if _share(stage) >= COMPARED:
                self._training = (elapsed + left, True)
            case "measure":
                self._measuring = _Seen(status["samples"], elapsed + left)

    def rest(self, status: dict[str, Any]) -> Rest | None:
        """What is left; None before the present stage has a pace, between two stages, and where nothing follows."""
        stage, samples = status["stage"], status["samples"]
        if stage is None or stage["remaining_s"] is None or _share(stage) >= 1.0:
            return None
        missing = status["samples_total"] - samples
        match stage["stage"]:
            case "trace":  # It tells of all paths, those too that are traced after learning.
                later, missing = self._learning(status["to_learn"]), 0
            case "references":
                later = [self._training, self._measuring.at(samples)]
                later += self._learning(status["to_learn"][1:])
            case "train":
                later = [self._left_to_compare(status), self._measuring.at(samples)]
                later += self._learning(status["to_learn"][1:])
            case "measure":
                later = self._learning(status["to_learn"][1:])
            case _:
                return None
        if missing > 0:
            later.append(UNKNOWN if self._tracing is None else (missing * self._tracing, True))
        traces = missing > 0 or stage["stage"] == "trace"
        seconds = stage["remaining_s"] + sum(seconds for seconds, _ in later)
        return Rest(seconds, all(is_whole for _, is_whole in later), traces) if later else None

    def of_stage(self, status: dict[str, Any]) -> float | None:
        """What is left of the present stage; None where nobody knows."""
        stage = status["stage"]
        if stage is None or stage["remaining_s"] is None or stage["stage"] != "train":
            return stage and stage["remaining_s"]
        seconds, is_known = self._left_to_compare(status)
        return stage["remaining_s"] + seconds if is_known else None

    def _left_to_compare(self, status: dict[str, Any]) -> Part:
        """Comparing that is still to be done, as long as the native module does not tell of it."""
        seconds, is_known = self._training
        return (0.0, True) if _share(status["stage"]) >= COMPARED else (max(seconds - self._limit, 0.0), is_known)

    def _learning(self, all_samples: list[int]) -> list[Part]:
        """Learning kinds of light, each from so many paths per pixel."""
        each = ((self._references.at(number), self._training, self._measuring.at(number)) for number in all_samples)
        return [part for parts in each for part in parts]


class _Seen(NamedTuple):
    """How long something took that takes longer with more paths per pixel, though not in proportion."""

    samples: int = 0
    seconds: float = 0.0

    def at(self, samples: int) -> Part:
        return self.seconds, 0 < samples <= self.samples


def _share(stage: dict[str, Any]) -> float:
    return float(stage["done"] / max(stage["total"], 1))
