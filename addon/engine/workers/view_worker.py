"""View tables (`export.color_table`) and their files (`export.view_file`), made in a Blender of their own: this one's
window would stand still while it reads the files of a view and colours."""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...export.color_table import Table, color_table
from ...export.view_file import write_view_table
from ...export.view_transform import set_view
from .process import Worker, blender_command, private_folder, telling_little_room

COMMAND = "color-view"
JOB, RESULT = "job.json", "table.npz"
SETTLE_SECONDS = 0.2
"""Seconds from asking for a job to its start: while a view is dragged no other Blender starts."""


def table_of(view: dict[str, Any]) -> dict[str, Any]:
    """Job of making the table of a view (`view_settings`)."""
    return {"view": view}


def file_of(view: dict[str, Any], path: Path, stamp: bytes) -> dict[str, Any]:
    """Job of writing the file of a view (`export.view_file`)."""
    return {"view": view, "file": str(path), "stamp": stamp.decode("latin-1")}


class ViewWorker:
    """The newest job, which replaces the one before, and the Blender that does it. Nothing waits here."""

    def __init__(self) -> None:
        self._job: dict[str, Any] = {}
        self._asked = 0.0
        """Time at which the job was asked for."""
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._worker: Worker | None = None

    def ask(self, job: dict[str, Any]) -> None:
        """Asks for a job, unless it is already under way; drops the one before."""
        if job != self._job:
            self.drop()
            self._job, self._asked = job, time.monotonic()

    def turn(self) -> Table | None:
        """Polls the job; returns its table when that is made. Raises OSError with why the job failed. Afterwards it may
        be asked for again."""
        try:
            return self._turn()
        except OSError:
            self.drop()
            raise

    def _turn(self) -> Table | None:
        if self._worker is None or self._folder is None:
            if self._job and time.monotonic() - self._asked >= SETTLE_SECONDS:
                self._start()
            return None
        if not self._worker.ended:
            return None
        self._worker.events()
        if self._worker.code != 0:
            raise OSError(self._worker.failure())
        table = None if "file" in self._job else _load(Path(self._folder.name) / RESULT)
        self.drop()
        return table

    def _start(self) -> None:
        self._folder = private_folder()
        place = Path(self._folder.name)
        with telling_little_room(place):
            (place / JOB).write_text(json.dumps(self._job), encoding="utf-8")
        self._worker = Worker(blender_command(None, [COMMAND, str(place), "--json"]), place)

    def drop(self) -> None:
        """Drops the job; nothing stays behind."""
        worker, folder = self._worker, self._folder
        self._job, self._worker, self._folder = {}, None, None
        if worker is not None and folder is not None:
            worker.end(folder.cleanup)
        elif folder is not None:
            folder.cleanup()


_shared = ViewWorker()


def shared() -> ViewWorker:
    """The one of this Blender."""
    return _shared


def _load(path: Path) -> Table:
    with np.load(path) as found:
        return found["table"], found.get("levels")


def color(place: Path) -> None:
    """Body of `relume color-view`, which runs in the other Blender: does the job of a folder."""
    job = json.loads((place / JOB).read_text(encoding="utf-8"))
    scene = bpy.context.scene
    set_view(scene, job["view"])
    if "file" in job:
        write_view_table(scene, Path(job["file"]), job["stamp"].encode("latin-1"))
        return
    table, levels = color_table(scene)
    if levels is None:
        np.savez(place / RESULT, table=table)
    else:
        np.savez(place / RESULT, table=table, levels=levels)
