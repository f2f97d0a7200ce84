"""Remaining time of a whole bake, tracing and learning, from the paces so far."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

COMPARED = 0.2
"""Share of learning by which the time that comparing takes is surely known: the native module compares at every
tenth, beside the time limit."""
Part: TypeAlias = tuple[float, bool]
"""Seconds of one part of the work, and True if it takes no longer."""
UNKNOWN: Part = (0.0, False)


class Eta(NamedTuple):
    """Remaining time of a bake in which more stages follow the present one."""

    seconds: float
    is_complete: bool
    """True if every remaining part has a known pace; otherwise it takes longer than `seconds`."""
    traces: bool
    """True if paths are still to be traced."""


class EtaEstimator:
    """Paces of one bake. Pass every status to `note` before asking about it."""

    def __init__(self, train_seconds: float) -> None:
        self._limit = train_seconds
        self._training: Part = (train_seconds, False)
        """Training of one kind of light, with comparing on the way."""
        self._tracing: float | None = None
        """Seconds for one more path per pixel."""
        self._references = _StageDuration()
        """Rendering the pictures that proxies are compared with."""
        self._measuring = _StageDuration()
        """Measuring the error of a proxy."""

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
                self._references = _StageDuration(status["samples"], elapsed + left)
            case "train" if _share(stage) >= COMPARED:
                self._training = (elapsed + left, True)
            case "measure":
                self._measuring = _StageDuration(status["samples"], elapsed + left)

    def remaining(self, status: dict[str, Any]) -> Eta | None:
        """Remaining time of the bake; None before the present stage has a pace, between stages, and in the last one."""
        stage, samples = status["stage"], status["samples"]
        if stage is None or stage["remaining_s"] is None or _share(stage) >= 1.0:
            return None
        missing = status["samples_total"] - samples
        match stage["stage"]:
            case "trace":  # Its remaining time covers all paths, also those that are traced after learning.
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
        return Eta(seconds, all(is_known for _, is_known in later), traces) if later else None

    def stage_remaining(self, status: dict[str, Any]) -> float | None:
        """Remaining seconds of the present stage; None if unknown."""
        stage = status["stage"]
        if stage is None or stage["remaining_s"] is None or stage["stage"] != "train":
            return stage and stage["remaining_s"]
        seconds, is_known = self._left_to_compare(status)
        return stage["remaining_s"] + seconds if is_known else None

    def _left_to_compare(self, status: dict[str, Any]) -> Part:
        """Remaining time of comparing, until the native module counts it itself."""
        seconds, is_known = self._training
        return (0.0, True) if _share(status["stage"]) >= COMPARED else (max(seconds - self._limit, 0.0), is_known)

    def _learning(self, all_samples: list[int]) -> list[Part]:
        """Parts of learning one kind of light for each number of paths per pixel."""
        each = ((self._references.at(number), self._training, self._measuring.at(number)) for number in all_samples)
        return [part for parts in each for part in parts]


class _StageDuration(NamedTuple):
    """Duration of a stage that takes longer with more paths per pixel, though not in proportion."""

    samples: int = 0
    seconds: float = 0.0

    def at(self, samples: int) -> Part:
        return self.seconds, 0 < samples <= self.samples


def _share(stage: dict[str, Any]) -> float:
    return float(stage["done"] / max(stage["total"], 1))
