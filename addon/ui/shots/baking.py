"""Bakes several shots of the list, one after the other, in Blenders of their own."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...engine.shot import background, shot, shot_list
from ...engine.shot.checks import ProblemError, check_folder, folders_in_use
from ...engine.shot.options import FolderError, options_of
from ...export.current_shot import entries
from ..background import poll


def bake_all(scene: bpy.types.Scene) -> background.Batch:
    """Bakes the shots that are on. Those that cannot be baked are named, and keep no other from it. Raises ProblemError
    if none can be, and NoCopyError."""
    if not (found := [entry for entry in entries(scene) if entry.on and not entry.is_foreign]):
        raise ProblemError("No shot is switched on; add cameras to the list, or switch shots on")
    problems = shot_list.problems(scene)
    wanted, failures = [], {}
    for entry in found:
        try:
            if words := problems.get(entry.key):
                raise ProblemError(words)
            options = options_of(scene, entry)
            _check_free(scene, options.folder)
            wanted.append((shot_list.listed(scene, entry), options))
        except (ProblemError, FolderError) as error:
            failures[entry.name] = str(error)
    if not wanted:
        raise ProblemError(words_of(failures))
    batch = background.start_all(scene, wanted)
    batch.failures |= failures
    poll()
    return batch


def _check_free(scene: bpy.types.Scene, folder: Path) -> None:
    opened = shot.of(scene)
    if opened is not None and opened.folder == folder and opened.is_working:
        raise ProblemError("it is being traced already; cancel that first")
    if use := folders_in_use(scene).get(folder):
        raise ProblemError(use)
    check_folder(folder)


def words_of(failures: dict[str, str]) -> str:
    """Every shot that failed, with the reason, for the artist."""
    return "; ".join(f"'{name}': {reason}" for name, reason in failures.items())


def stop(scene: bpy.types.Scene) -> None:
    """Stops the bakes of a scene's shots; what is written stays."""
    batch = background.batch_of(scene)
    if batch is not None:
        batch.cancel()


def is_running(scene: bpy.types.Scene) -> bool:
    """True while shots of a scene are baked."""
    batch = background.batch_of(scene)
    return batch is not None and batch.is_running
