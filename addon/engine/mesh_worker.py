"""Has another Blender finish meshes (`export.late_mesh`) while a scene is read. It waits for the next ones for as long
as the scene may be read again soon."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import bpy

from ..core import array_file
from ..export.geometry import mesh_arrays
from ..export.late_mesh import FinishMesh, LateMesh, finished
from .process import Worker, blender_command, private_folder, telling_little_room
from .render_depsgraph import ExportCancelled, Stop

COMMAND = "finish-meshes"
JOB, RESULT = ".job", ".mesh"
"""What the names of files end with, after the number of the mesh."""
IDLE_SECONDS = 120.0
"""How long the other Blender waits for the next mesh."""
POLL_SECONDS = 0.005


class MeshWorker:
    """The side of the Blender whose scene is read, on the thread that reads it."""

    def __init__(self) -> None:
        self._folder = private_folder()
        self._place = Path(self._folder.name)
        self._worker: Worker | None = None
        self._count = 0
        self._told: dict[int, str] = {}
        """By the numbers of meshes that are done: why it failed, or nothing."""

    def begin(self, plain: dict[str, Any], asked: Collection[str]) -> int:
        """Has a mesh finished and read (`mesh_arrays`); the number to `take` it by. Raises OSError."""
        self._count += 1
        with telling_little_room(self._place):
            part = self._place / ".part"
            array_file.write(part, {"late": plain, "asked": sorted(asked)})
            os.replace(part, self._place / f"{self._count}{JOB}")
        if not self.is_working:
            self._worker = Worker(blender_command(None, [COMMAND, str(self._place), "--json"]), self._place)
        return self._count

    def take(self, number: int, stop: Stop) -> dict[str, Any]:
        """The arrays of a mesh. Waits; raises `ExportCancelled` soon after `stop` says so, and OSError."""
        while number not in self._told:
            if stop():
                raise ExportCancelled("cancelled")
            worker = self._worker
            if worker is None:
                raise OSError("the other Blender was ended")
            has_ended = worker.ended
            self._told |= {event["number"]: event.get("failed", "") for event in worker.events() if "number" in event}
            if has_ended and number not in self._told:
                raise OSError(worker.failure())
            time.sleep(POLL_SECONDS)
        if words := self._told.pop(number):
            raise OSError(words)
        path = self._place / f"{number}{RESULT}"
        arrays = array_file.read(path)
        path.unlink(missing_ok=True)
        return arrays

    @property
    def is_working(self) -> bool:
        """Whether the other Blender is at work or waits."""
        return self._worker is not None and not self._worker.ended

    def close(self) -> None:
        """Ends it; nothing stays behind."""
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.end(self._folder.cleanup)
        else:
            self._folder.cleanup()


_shared: MeshWorker | None = None


def finisher(stop: Stop) -> FinishMesh:
    """What `export_scene` has meshes finished by, with the other Blender of this one; waiting for it raises
    `ExportCancelled` soon after `stop` says so."""

    def begin(late: LateMesh, asked: Collection[str]) -> Callable[[], dict[str, Any]]:
        worker = _shared or _open()
        number = worker.begin(late.plain, asked)

        def take() -> dict[str, Any]:
            try:
                return worker.take(number, stop)
            except ExportCancelled:
                close()  # Nobody wants the others.
                raise

        return take

    return begin


def _open() -> MeshWorker:
    global _shared
    _shared = MeshWorker()
    return _shared


def close() -> None:
    """Ends the other Blender, if there is one."""
    global _shared
    if _shared is not None:
        _shared.close()
    _shared = None


def serve(place: Path, tell: Callable[[dict[str, Any]], None]) -> None:
    """The body of `relume finish-meshes`, in the other Blender: does the jobs of a folder one after the other, and
    tells of each by its number, until none has come for a while."""
    since = time.monotonic()
    while place.is_dir() and time.monotonic() - since < IDLE_SECONDS:
        for number in _waiting(place):
            try:
                _do(place, number)
                tell({"number": number})
            except (OSError, RuntimeError, TypeError, ValueError) as error:
                tell({"number": number, "failed": str(error)})
            since = time.monotonic()
        time.sleep(POLL_SECONDS)


def _waiting(place: Path) -> list[int]:
    return sorted(int(path.name.removesuffix(JOB)) for path in place.glob(f"*{JOB}"))


def _do(place: Path, number: int) -> None:
    path = place / f"{number}{JOB}"
    job = array_file.read(path)
    path.unlink()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    array_file.write(place / f"{number}{RESULT}", mesh_arrays(finished(job["late"]), job["asked"]))
