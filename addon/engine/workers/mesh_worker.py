"""Finishing of meshes (`export.late_mesh`) in another Blender (`engine.workers.helper`) while a scene is read."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from ...core import array_file
from ...export.geometry import mesh_arrays
from ...export.late_mesh import FinishMesh, LateMesh, finished
from ..reading.render_depsgraph import ExportCancelled, Stop
from . import helper

KIND = "mesh"
POLL_SECONDS = 0.005


@contextmanager
def finishing(stop: Stop) -> Iterator[FinishMesh]:
    """Context of the function by which `export_scene` has meshes finished. Waiting for a mesh raises `ExportCancelled`
    soon after `stop` returns True. At the end, meshes that nobody took are dropped."""
    begun: list[tuple[helper.Helper, int]] = []

    def begin(late: LateMesh, asked: Collection[str]) -> Callable[[], dict[str, Any]]:
        other = helper.shared()
        number = other.begin(KIND, {"late": late.plain, "asked": sorted(asked)})
        begun.append((other, number))
        return partial(_take, other, number, stop)

    try:
        yield begin
    finally:
        for other, number in begun:
            other.interrupt(number)


def _take(other: helper.Helper, number: int, stop: Stop) -> dict[str, Any]:
    """Waits for the arrays of a mesh. Raises `ExportCancelled` and OSError."""
    while True:
        for told in other.take(number):
            if "mesh" in told:
                arrays = array_file.read(Path(told["mesh"]))
                other.drop(number)
                return arrays
        if stop():
            raise ExportCancelled("cancelled")
        time.sleep(POLL_SECONDS)


def work(prefix: str, job: dict[str, Any]) -> Iterator[helper.Told]:
    """Finishes a mesh and reads it (`helper.Work`). Runs in the other Blender."""
    path = f"{prefix}{KIND}"
    with finished(job["late"]) as mesh:
        array_file.write(Path(path), mesh_arrays(mesh, job["asked"]))
    yield {"mesh": path}
