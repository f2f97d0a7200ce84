"""Progress on standard output, for people or for machines."""

from __future__ import annotations

import json
import sys
import time
from typing import Any, TextIO

from .words import grouped

SECONDS_BETWEEN_LINES = 1.0


class Reporter:
    """Prints progress, at most one line a second for each stage; warnings and results always. Warnings of one
    stage that are alike are printed as one, at its end."""

    def __init__(self, quiet: bool = False, as_json: bool = False, stream: TextIO | None = None):
        self.quiet = quiet
        self.as_json = as_json
        self.stream = stream or sys.stdout
        self.last: tuple[str, float] = ("", 0.0)
        self.stage = ""
        self.waiting: list[str] = []
        """Warnings that are not printed yet."""

    def progress(self, report: dict[str, Any]) -> None:
        """Prints a report of the native module: stage, done, total, remaining_s, message."""
        if report["stage"] != self.stage:  # Those of one stage come together.
            self.flush()
            self.stage = report["stage"]
        if self.quiet:
            return
        now, finished = time.monotonic(), report["done"] >= report["total"]
        stage, printed = self.last
        if stage == report["stage"] and now - printed < SECONDS_BETWEEN_LINES and not finished:
            return
        self.last = (report["stage"], now)
        self._print({"event": "progress", **report} if self.as_json else progress_line(report))

    def warning(self, message: str) -> None:
        """Prints a warning, together with those that follow at once."""
        self.waiting.append(message)

    def flush(self) -> None:
        """Prints the warnings that came so far."""
        warnings, self.waiting = grouped(tuple(self.waiting)), []
        for message in warnings:
            self._print({"event": "warning", "message": message} if self.as_json else f"Warning: {message}")

    def result(self, result: dict[str, Any], text: str) -> None:
        """Prints the end of a command."""
        self.flush()
        if self.as_json:
            self._print({"event": "result", **result})
        elif not self.quiet:
            self._print(text)

    def error(self, message: str) -> None:
        """Prints why a command failed: on standard error for people, where all else is for machines."""
        self.flush()
        if self.as_json:
            self._print({"event": "error", "message": message})
        else:
            print(f"Error: {message}", file=sys.stderr, flush=True)

    def _print(self, line: dict[str, Any] | str) -> None:
        print(line if isinstance(line, str) else json.dumps(line), file=self.stream, flush=True)


def progress_line(report: dict[str, Any]) -> str:
    """Line of progress, for example `trace 42 %, 1:05 left, 12 of 30 tiles`."""
    percent = 100 * report["done"] // max(report["total"], 1)
    parts = [f"{report['stage']} {percent:3d} %"]
    if report.get("remaining_s") is not None:
        parts.append(f"{clock(report['remaining_s'])} left")
    if report.get("message"):
        parts.append(report["message"])
    return ", ".join(parts)


def share_and_words(report: dict[str, Any]) -> tuple[float, str]:
    """The share that is done, and a text: `42 %, 1:05 left`, as long as there is no pace `42 %`."""
    share = min(max(report["done"] / max(report["total"], 1), 0.0), 1.0)
    left = report.get("remaining_s")
    return share, f"{100 * share:.0f} %" if left is None else f"{100 * share:.0f} %, {clock(left)} left"


class Pace:
    """Estimate of the remaining time of steps of one length, from the durations of those that are done."""

    def __init__(self) -> None:
        self.began = time.monotonic()

    def remaining(self, done: int, total: int) -> float | None:
        """Seconds to the end; None before the first step is done."""
        return (time.monotonic() - self.began) * (total - done) / done if done else None


def clock(seconds: float) -> str:
    """`m:ss`, or `h:mm:ss` from an hour on."""
    minutes, seconds = divmod(int(seconds + 0.5), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
