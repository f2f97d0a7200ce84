"""Paths that look for lights where a solver has put them. Few of a bake's own paths meet a small light that was moved
far, so that its picture is noise and the solver cannot tell how well it serves."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy

from ..core.bake_folder import MANIFEST, SOLVE, clear
from ..core.solve import SolveError
from ..export import trace_settings
from .native import native
from .scene import load_scene_async
from .shot import Shot
from .solve import answer

SAMPLES = 64
"""Paths per pixel, where the bake has as many."""


@contextmanager
def folder_in(shot: Shot) -> Iterator[Path]:
    """A folder for a small bake inside of a shot's, which is emptied in the end."""
    folder = shot.folder / SOLVE
    _remove(folder)
    try:
        yield folder
    finally:
        _remove(folder)


def _remove(folder: Path) -> None:
    with suppress(OSError):
        clear(folder)
        folder.rmdir()


def bake(scene: bpy.types.Scene, shot: Shot, lights: list[dict[str, Any]], folder: Path) -> Generator[Any, None, bool]:
    """Bakes a few paths of the shot into the folder which look for these lights besides those of the scene; yields the
    running job, or None before there is one. False where the scene is no longer that of the shot. Raises SolveError."""
    exported = yield from _export(scene)
    if exported.hash != json.loads((shot.folder / MANIFEST).read_text(encoding="utf-8"))["scene_hash"]:
        return False
    settings = trace_settings(scene, lambda _warning: None)
    settings |= {"samples": min(SAMPLES, shot.status["samples"]), "threads": shot.options.threads, "towards": lights}
    job = native().bake(exported, folder, settings)
    try:
        while not job.done:
            yield job
    except GeneratorExit:  # Cancelled: it must not write into a folder that is being emptied.
        job.cancel()
        with suppress(RuntimeError):
            job.result()
        raise
    answer(job)
    return True


def _export(scene: bpy.types.Scene) -> Generator[None, None, Any]:
    found: list[tuple[Any, BaseException | None]] = []
    task = load_scene_async(scene, None, lambda exported, error: found.append((exported, error)))
    try:
        while not found:
            yield
    finally:
        if task is not None and not found:
            task.cancel()
    exported, error = found[0]
    if error is not None:
        raise SolveError(f"The scene could not be read: {error}") from error
    return exported
