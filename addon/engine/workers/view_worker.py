"""View tables (`export.color_table`, `export.view_file`) and shaders (`viewport.driver_cache`), made in another Blender
(`engine.workers.helper`).

In this one the window would stand still while it reads the files of a view, while it colours, and while the graphics
driver compiles. A newer job replaces the one before."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.background_call import run_in_thread
from ...core.fresh_memory import FreshMemory
from ...export.color_table import COARSE, FINE, Table, color_table
from ...export.view_file import write_view_table
from ...export.view_transform import set_view
from . import helper

KIND = "view"
POLL_SECONDS = 0.02
SETTLE_SECONDS = 0.2
"""Seconds between the coarse table and the fine one: while a view is dragged coarse ones follow it."""
Compile = Callable[[tuple[int, int]], Iterator[None]]
"""Compiles what draws pictures of a size, a piece at a time."""


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
    """The window's side, on its thread. Nothing waits here."""

    def __init__(self) -> None:
        self._helper: helper.Helper | None = None
        self._job: dict[str, Any] = {}
        self._number = 0
        self._told: list[helper.Told] = []
        self._loading: Generator[None, None, tuple[Table, FreshMemory]] | None = None
        self.is_finished = False
        """True if all of the newest job was done and taken."""

    def ask(self, job: dict[str, Any]) -> None:
        """Begins a job, unless it is already under way; drops the one before. Raises OSError."""
        if job == self._job:
            return
        self.drop()
        self._helper = helper.shared()
        self._number = self._helper.begin(KIND, job)
        self._job = job

    def turn(self) -> tuple[Table, FreshMemory] | None:
        """A table of the job, better than the one before, if one has come, and as much memory as software graphics
        take for it: its texels, twice. Raises OSError with why the job failed; it may be asked for again."""
        if self._helper is None:
            return None
        try:
            self._told += self._helper.take(self._number)
        except OSError:
            self.drop()
            raise
        if self._loading is None and self._told:
            self._take(self._told.pop(0))
        if self._loading is not None:
            try:
                next(self._loading)
            except StopIteration as end:
                self._loading = None
                return end.value
        return None

    def _take(self, told: helper.Told) -> None:
        if "table" in told:
            self._loading = run_in_thread(partial(_load, Path(told["table"])))
        else:
            self.drop()
            self.is_finished = True

    def drop(self, at_once: bool = False) -> None:
        """Drops the job; `at_once` if it would take too long to be left alone (`helper`)."""
        if self._helper is not None:
            (self._helper.interrupt if at_once else self._helper.drop)(self._number)
        self._helper, self._job = None, {}
        self._told, self._loading, self.is_finished = [], None, False


_shared = ViewWorker()


def shared() -> ViewWorker:
    """The one of this Blender."""
    return _shared


def _load(path: Path) -> tuple[Table, FreshMemory]:
    with np.load(path) as found:
        entries, levels = found["table"], found.get("levels")
    copies = 1 if levels is None else 2  # Without levels its texels are half floats (`viewport.texture.of_table`).
    return (entries, levels), FreshMemory(copies * entries.nbytes)


def work(compile_programs: Compile, prefix: str, job: dict[str, Any]) -> Iterator[helper.Told]:
    """Does a job (`helper.Work`). Runs in the other Blender."""
    if "programs" in job:
        for _ in compile_programs(tuple(job["programs"])):
            yield {}
        return
    scene = bpy.context.scene
    set_view(scene, job["view"])
    if "file" in job:
        write_view_table(scene, Path(job["file"]), job["stamp"].encode("latin-1"))
        return
    yield {"table": _save(f"{prefix}coarse.npz", color_table(scene, COARSE))}
    until = time.monotonic() + SETTLE_SECONDS
    while time.monotonic() < until:
        time.sleep(POLL_SECONDS)
        yield {}
    yield {"table": _save(f"{prefix}fine.npz", color_table(scene, FINE))}


def _save(path: str, table: Table) -> str:
    entries, levels = table
    if levels is None:
        np.savez(path, table=entries)
    else:
        np.savez(path, table=entries, levels=levels)
    return path
