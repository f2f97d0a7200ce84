"""The helper: a Blender in the background for what is soon done and would hold up the window
(`engine.workers.view_worker`, `engine.workers.mesh_worker`). It starts with the first job and waits for more of them.

A job is a file in a folder that both see, and wanted while that is there: a helper that was ended is replaced by one
that does what is left."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...core import array_file
from .process import Worker, blender_command, private_folder, telling_little_room

COMMAND = "help-window"
JOB = ".job"
"""Suffix of jobs' files, after the number and the kind."""
IDLE_SECONDS = 120.0
"""Seconds that an idle helper waits for the next job."""
POLL_SECONDS = 0.01
Told = dict[str, Any]
Work = Callable[[str, Any], Iterator[Told]]
"""Does a job a piece at a time and yields what is to be told of it, which may be nothing. Paths of files that it makes
begin with the words it is given. Between two pieces other jobs are done, or this one is dropped."""


class Helper:
    """The window's side. Threads may share it; nothing waits for the other Blender."""

    def __init__(self) -> None:
        self._folder = private_folder()
        self._place = Path(self._folder.name)
        self._lock = threading.Lock()
        self._worker: Worker | None = None
        self._number = 0
        self._told: dict[int, list[Told]] = {}
        """Reports that nobody has taken yet, by the numbers of jobs whose results are still wanted."""

    def begin(self, kind: str, job: Any) -> int:
        """Begins a job of plain data and arrays (`core.array_file`); returns its number. Raises OSError."""
        with self._lock:
            self._number += 1
            number = self._number
            self._told[number] = []
        try:
            with telling_little_room(self._place):
                part = self._place / f"{number}.part"
                array_file.write(part, job)
                os.replace(part, self._place / f"{number}.{kind}{JOB}")
            with self._lock:
                self._keep_alive()
        except OSError:
            self.drop(number)
            raise
        return number

    def take(self, number: int) -> list[Told]:
        """Takes the reports of a job since the last call; the last one is `{"finished": True}`. Raises OSError with the
        reason if the job failed, and if it was dropped."""
        with self._lock:
            self._listen()
            if number not in self._told:
                raise OSError("the other Blender was ended")
            told, self._told[number] = self._told[number], []
        for event in told:
            if "failed" in event:
                raise OSError(event["failed"])
        return told

    def drop(self, number: int) -> None:
        """Drops a job whose result nobody wants any more, or was taken; removes its files."""
        with self._lock:
            self._told.pop(number, None)
            _remove(self._place.glob(f"{number}[.-]*"))

    def interrupt(self, number: int) -> None:
        """Drops a job that may take long. If it is under way, the other Blender ends and a new one does the remaining
        jobs."""
        is_done = not any(self._place.glob(f"{number}.*{JOB}"))
        self.drop(number)
        if not is_done:
            with self._lock:
                worker, self._worker = self._worker, None
            if worker is not None:
                worker.end(lambda: None)

    @property
    def is_running(self) -> bool:
        """True while the other Blender works or waits."""
        worker = self._worker
        return worker is not None and not worker.ended

    def _keep_alive(self) -> None:
        if self._worker is None and any(self._place.glob(f"*{JOB}")):
            self._worker = Worker(blender_command(None, [COMMAND, str(self._place), "--json"]), self._place)

    def _listen(self) -> None:
        worker = self._worker
        if worker is not None:
            has_ended = worker.ended
            for event in worker.events():
                if event.get("number") in self._told:
                    self._told[event["number"]].append(event)
            if has_ended:
                self._worker = None
                if worker.code != 0:
                    self._fail(worker.failure())
        self._keep_alive()

    def _fail(self, words: str) -> None:
        """Tells it of every job that is not done."""
        for file in self._place.glob(f"*{JOB}"):
            self._told.get(_number_of(file), []).append({"failed": words})
            _remove([file])

    def close(self) -> None:
        """Ends it; nothing stays behind."""
        with self._lock:
            worker, self._worker = self._worker, None
            self._told.clear()
        if worker is not None:
            worker.end(self._folder.cleanup)
        else:
            self._folder.cleanup()


_shared: Helper | None = None
_opening = threading.Lock()


def shared() -> Helper:
    """The one of this Blender. Raises OSError."""
    global _shared
    with _opening:
        if _shared is None:
            _shared = Helper()
        return _shared


def close() -> None:
    """Ends it, if there is one."""
    global _shared
    with _opening:
        helper, _shared = _shared, None
    if helper is not None:
        helper.close()


def serve(place: Path, tell: Callable[[Told], None], works: Mapping[str, Work]) -> None:
    """The body of `relume help-window`, in the other Blender: does the jobs of a folder by their kinds, the most urgent
    of `works` first, and tells of each with its number, until none has come for a while."""
    begun: dict[int, Iterator[Told]] = {}
    since = time.monotonic()
    while place.is_dir() and time.monotonic() - since < IDLE_SECONDS:
        waiting = _waiting(place, list(works))
        for number in begun.keys() - waiting.keys():
            del begun[number]
            _remove(place.glob(f"{number}-*"))
        if not waiting:
            time.sleep(POLL_SECONDS)
            continue
        number, file = next(iter(waiting.items()))
        try:
            if number not in begun:
                begun[number] = works[_kind_of(file)](str(place / f"{number}-"), array_file.read(file))
            told = next(begun[number], {"finished": True})
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            told = {"failed": str(error)}
        if told:
            tell(told | {"number": number})
        if "finished" in told or "failed" in told:
            begun.pop(number, None)
            _remove([file])
        since = time.monotonic()


def _waiting(place: Path, kinds: list[str]) -> dict[int, Path]:
    """Files of jobs by their numbers, the most urgent first."""
    files = sorted(place.glob(f"*{JOB}"), key=lambda file: (kinds.index(_kind_of(file)), _number_of(file)))
    return {_number_of(file): file for file in files}


def _number_of(job: Path) -> int:
    return int(job.name.split(".")[0])


def _kind_of(job: Path) -> str:
    return job.name.split(".")[1]


def _remove(files: Iterable[Path]) -> None:
    for file in files:
        with suppress(OSError):  # Windows leaves one that is being read.
            file.unlink()
