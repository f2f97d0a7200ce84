"""Checks for problems that keep a scene from being baked, each in one line for the artist."""

from __future__ import annotations

import errno
import tempfile
from collections.abc import Callable
from pathlib import Path

import bpy

from ...core.disk import expected_size, in_words
from ...export.camera import PLANAR, film_size, why_no_picture
from ...export.current_shot import current_entry
from . import background, cache, shot_list
from . import shot as shots
from .options import FolderError, bake_folder, options_of


class ProblemError(Exception):
    """Problem that the artist has to solve first; the message says what and how."""


def check_start(scene: bpy.types.Scene, folder: Path | None = None) -> None:
    """Raises ProblemError if the scene cannot be baked now, into its folder or another one."""
    if bpy.app.is_job_running("RENDER"):
        raise ProblemError("A render is running; start Relume when it has ended")
    camera = scene.camera
    if camera is None or camera.type != "CAMERA":
        raise ProblemError(f"Scene '{scene.name}' has no camera; add one and make it the active camera")
    if camera.data.type not in {*PLANAR, "PANO"}:
        kind = camera.data.type.lower()
        raise ProblemError(f"Camera '{camera.name}' is {kind}; use a perspective, orthographic or panoramic one")
    if words := why_no_picture(scene):
        raise ProblemError(words)
    try:
        folder = folder or bake_folder(scene)
    except FolderError as error:
        raise ProblemError(str(error)) from error
    entry = current_entry(scene)
    if entry is not None and (problem := shot_list.problems(scene).get(entry.key)):
        raise ProblemError(f"Shot '{entry.name}': {problem}")
    use = folders_in_use(scene).get(folder)
    if use is not None:
        raise ProblemError(use)
    check_folder(folder)


def folders_in_use(scene: bpy.types.Scene | None = None) -> dict[Path, str]:
    """Bake folders that are deleted, written to, or shown other than by the open shot of `scene`, with what to do about
    it."""
    uid = scene.session_uid if scene is not None else None
    shown = {shot.folder for shot in shots.all_open() if shot.scene_uid != uid}
    written = {job.folder for job in background.all_jobs() if job.is_running}
    written |= {folder for batch in background.all_batches() for folder in batch.folders}
    return {
        **{
            folder: f"Another scene of this file is baked in '{folder}'; choose another bake folder" for folder in shown
        },
        **dict.fromkeys(cache.going(), "The bake of this shot is being deleted by Clean Up; start when that has ended"),
        **dict.fromkeys(written, "This shot is being baked in the background; wait for its end, or stop it there"),
    }


def disk_space(scene: bpy.types.Scene, free_on: Callable[[Path], int | None]) -> tuple[str, bool]:
    """Size of a bake of the scene in words, and True if the disk has room for it; `free_on` is called like
    `free_space`."""
    try:
        options = options_of(scene)
    except FolderError as error:
        return str(error), False
    size = expected_size(options.resolution or film_size(scene.render), options.samples)
    words = f"About {in_words(size)} on disk"
    free = free_on(options.folder)
    return (words, True) if free is None or size < free else (f"{words}, but only {in_words(free)} free", False)


def check_folder(folder: Path) -> None:
    """Makes the folder and writes a small file into it, to know now that it can be done."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder, prefix=".check-") as file:
            file.write(bytes(4096))
            file.flush()  # Not on to the disk, which may take its time.
    except OSError as error:
        raise ProblemError(_folder_problem(folder, error)) from error


def _folder_problem(folder: Path, error: OSError) -> str:
    if error.errno in {errno.ENOSPC, errno.EDQUOT}:
        return f"The disk is full: '{folder}'; free some space or choose another bake folder"
    if error.errno in {errno.EACCES, errno.EPERM, errno.EROFS}:
        return f"The folder is read-only: '{folder}'; choose another bake folder"
    if isinstance(error, (FileExistsError, NotADirectoryError)):
        return f"'{error.filename or folder}' is a file; choose another bake folder"
    return f"The folder cannot be used: '{folder}' ({error.strerror}); choose another bake folder"
