"""Has Blender colour the tables of views (`export.color_table`, `export.view_file`) and compile what draws with them
(`viewport.rehearsal`) in a Blender of its own: the window would stand still while it reads the files of a view, while
it colours, and while the graphics driver compiles.

The other Blender waits for the next view as long as one may be wanted soon. Newer jobs replace the one before."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..core.apart import apart
from ..export.color_table import COARSE, FINE, Table, color_table
from ..export.view_file import write_view_table
from ..export.view_transform import set_view
from .process import Worker, blender_command, private_folder, telling_little_room

COMMAND = "colour-views"
JOB = "-job.json"
"""After a job's number, the name of its file."""
IDLE_SECONDS = 120.0
"""How long the other Blender waits for the next view."""
POLL_SECONDS = 0.02
SETTLE_SECONDS = 0.2
"""Between the coarse table and the fine one: while a view is dragged coarse ones follow it."""
Compile = Callable[[tuple[int, int]], None]
"""Compiles what draws pictures of a size."""


def tables_of(view: dict[str, Any]) -> dict[str, Any]:
    """The job of making the tables of a view (`view_settings`), a coarse one first."""
    return {"view": view}


def file_of(view: dict[str, Any], path: Path, stamp: bytes) -> dict[str, Any]:
    """The job of writing the file of a view (`export.view_file`)."""
    return {"view": view, "file": str(path), "stamp": stamp.decode("latin-1")}


def programs_of(film: tuple[int, int]) -> dict[str, Any]:
    """The job of compiling what draws pictures of a size."""
    return {"programs": film}


class ViewWorker:
    """The window's side. Nothing waits here."""

    def __init__(self) -> None:
        self._folder = private_folder()
        self._place = Path(self._folder.name)
        self._worker: Worker | None = None
        self._job: dict[str, Any] = {}
        self._number = 0
        self._told: list[dict[str, Any]] = []
        self._loading: Generator[None, None, Table] | None = None
        self.is_finished = False
        """Whether all of the newest job was done and taken."""

    def ask(self, job: dict[str, Any]) -> None:
        """Has a job done, unless it is at it; drops the one before. To be called at each turn. Raises OSError."""
        if job != self._job or self.is_finished:
            self._number += 1
            self._told, self._loading, self.is_finished = [], None, False
            with telling_little_room(self._place):
                part = self._place / ".part"
                part.write_text(json.dumps(job), encoding="utf-8")
                os.replace(part, self._place / f"{self._number}{JOB}")
            self._job = job
        if self._worker is None:
            self._worker = Worker(blender_command(None, [COMMAND, str(self._place), "--json"]), self._place)

    def turn(self) -> Table | None:
        """A table of the job, better than the one before, if one has come. Raises OSError with why the job failed; it
        may be asked for again."""
        self._listen()
        if self._loading is None and self._told:
            self._take(self._told.pop(0))
        if self._loading is not None:
            try:
                next(self._loading)
            except StopIteration as end:
                self._loading = None
                return end.value
        return None

    def _take(self, told: dict[str, Any]) -> None:
        if "failed" in told:
            self._job = {}
            raise OSError(told["failed"])
        if "table" in told:
            self._loading = apart(partial(_load, Path(told["table"])))
        else:
            self.is_finished = True

    def _listen(self) -> None:
        worker = self._worker
        if worker is None:
            return
        has_ended = worker.ended
        self._told += [event for event in worker.events() if event.get("number") == self._number]
        if has_ended:
            self._worker = None
            if worker.code != 0 and not self.is_finished:
                self._job = {}
                raise OSError(worker.failure())

    def close(self) -> None:
        """Ends it; nothing stays behind."""
        if self._worker is not None:
            self._worker.end(self._folder.cleanup)
        else:
            self._folder.cleanup()


_shared: ViewWorker | None = None


def shared() -> ViewWorker:
    """The one of this Blender. Raises OSError."""
    global _shared
    if _shared is None:
        _shared = ViewWorker()
    return _shared


def close() -> None:
    """Ends it, if there is one."""
    global _shared
    if _shared is not None:
        _shared.close()
    _shared = None


def _load(path: Path) -> Table:
    with np.load(path) as found:
        table = found["table"], found.get("levels")
    path.unlink(missing_ok=True)
    return table


def serve(place: Path, tell: Callable[[dict[str, Any]], None], compile_programs: Compile) -> None:
    """The body of `relume colour-views`, in the other Blender: does the jobs of a folder, and tells of each with its
    number, until none has come for a while."""
    done, since = 0, time.monotonic()
    while place.is_dir() and time.monotonic() - since < IDLE_SECONDS:
        number = _newest(place)
        if number == done:
            time.sleep(POLL_SECONDS)
            continue
        done = number
        try:
            for event in _do(place, number, compile_programs):
                tell(event | {"number": number})
        except (OSError, RuntimeError, TypeError) as error:
            tell({"number": number, "failed": str(error)})
        since = time.monotonic()


def _newest(place: Path) -> int:
    """Number of the newest job, 0 without one. Each has a file of its own: Windows replaces none that is being read."""
    return max((int(path.name.removesuffix(JOB)) for path in place.glob(f"*{JOB}")), default=0)


def _do(place: Path, number: int, compile_programs: Compile) -> Iterator[dict[str, Any]]:
    scene, job = bpy.context.scene, json.loads((place / f"{number}{JOB}").read_text(encoding="utf-8"))
    if "view" in job:
        set_view(scene, job["view"])
    if "programs" in job:
        compile_programs(tuple(job["programs"]))
    elif "file" in job:
        write_view_table(scene, Path(job["file"]), job["stamp"].encode("latin-1"))
    else:
        yield {"table": _save(place / f"{number}-coarse.npz", color_table(scene, COARSE))}
        if _is_replaced_soon(place, number):
            return
        yield {"table": _save(place / f"{number}-fine.npz", color_table(scene, FINE))}
    yield {"finished": True}


def _save(path: Path, table: Table) -> str:
    entries, levels = table
    if levels is None:
        np.savez(path, table=entries)
    else:
        np.savez(path, table=entries, levels=levels)
    return str(path)


def _is_replaced_soon(place: Path, number: int) -> bool:
    until = time.monotonic() + SETTLE_SECONDS
    while time.monotonic() < until:
        if _newest(place) != number:
            return True
        time.sleep(POLL_SECONDS)
    return False
