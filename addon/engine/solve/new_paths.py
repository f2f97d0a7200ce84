"""Paths that are guided towards lights where a solver has put them. Few of a bake's own paths meet a small light that
was moved far: its picture is noise, and the solver cannot measure it."""

from __future__ import annotations

import json
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import bpy

from ...core.bake_folder import MANIFEST, SOLVE, clear
from ...core.solve import SolveError, samples_towards
from ...export import trace_settings
from ..native import native
from ..reading.scene import load_scene_async
from ..shot.shot import Shot
from .handle import answer

CLEAN_SECONDS = 0.25
"""Seconds between checks for the end of cancelled jobs."""

_ending: list[tuple[Any, Path]] = []
"""Cancelled jobs that may still write or read, and the folder that goes when they are done."""


@contextmanager
def folder_in(shot: Shot) -> Iterator[Path]:
    """A folder for a small bake inside of a shot's, which is emptied in the end. Raises SolveError while a job that was
    cancelled still works in it."""
    folder = shot.folder / SOLVE
    clean_up()
    if _is_used(folder):
        raise SolveError("the solve before is still ending")
    _remove(folder)
    try:
        yield folder
    finally:
        if not _is_used(folder):
            _remove(folder)


def cancel(job: Any, folder: Path) -> None:
    """Asks a job to end without waiting for that; the folder is emptied once it has."""
    job.cancel()
    _ending.append((job, folder))
    if not bpy.app.background and not bpy.app.timers.is_registered(clean_up):
        bpy.app.timers.register(clean_up, first_interval=CLEAN_SECONDS, persistent=True)


def clean_up() -> float | None:
    """Empties the folders of cancelled jobs that have ended; seconds until the next look."""
    folders = {folder for job, folder in _ending if job.done}
    _ending[:] = [(job, folder) for job, folder in _ending if not job.done]
    for folder in folders:
        if not _is_used(folder):
            _remove(folder)
    return CLEAN_SECONDS if _ending else None


def _is_used(folder: Path) -> bool:
    return any(used == folder for _, used in _ending)


def _remove(folder: Path) -> None:
    with suppress(OSError):
        clear(folder)
        folder.rmdir()


def bake(scene: bpy.types.Scene, shot: Shot, lights: list[dict[str, Any]], folder: Path) -> Generator[Any, None, bool]:
    """Bakes a few paths of the shot into the folder, guided towards these lights besides those of the scene. Yields the
    running job, or None before there is one. Returns False if the shot is of another scene by now. Raises
    SolveError."""
    exported = yield from _export(scene)
    baked = json.loads((shot.folder / MANIFEST).read_text(encoding="utf-8"))["scene_hash"]
    if (exported.hash, exported.world_map) != (baked, shot.status["world_map"]):
        return False
    settings = trace_settings(scene, lambda _warning: None)
    samples = samples_towards(shot.status["samples"])
    settings |= {"samples": samples, "threads": shot.options.threads, "towards": lights}
    # The request's factors on the light of the world are relative to that of the shot's bake.
    settings["world_color"] = shot.status["world_color"]
    job = native().bake(exported, folder, settings)
    try:
        while not job.done:
            yield job
    except GeneratorExit:  # Cancelled. Waiting for its end would hold up the window.
        cancel(job, folder)
        raise
    answer(job)
    return True


def _export(scene: bpy.types.Scene) -> Generator[None, None, Any]:
    results: list[tuple[Any, BaseException | None]] = []
    task = load_scene_async(scene, None, lambda exported, error: results.append((exported, error)))
    try:
        while not results:
            yield
    finally:
        if task is not None and not results:
            task.cancel()
    exported, error = results[0]
    if error is not None:
        raise SolveError(f"The scene could not be read: {error}") from error
    return exported
