"""The command line in Blender for several shots of a scene's list."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import bpy

from .core import shots
from .core.command_line import UsageError
from .core.progress import Reporter
from .core.shots import ListedShot
from .engine.reading.scene import load_scene_for
from .engine.shot import shot_list
from .engine.shot.options import options_of
from .export import ExportError, ExportOptions
from .export.current_shot import entries
from .export.view_layer import force_layer

OpenScene = Callable[[argparse.Namespace, Reporter], bpy.types.Scene]
LoadScene = Callable[[bpy.types.Scene, ExportOptions], Any]
"""Reads a scene as `load_scene` does."""
Bake = Callable[[bpy.types.Scene, argparse.Namespace, Reporter, LoadScene], dict[str, Any]]

LIST_FILE = shot_list.LIST_FILE
OF_SHOTS = ("camera", "frame", "layer", "resolution", "resolution_percentage")
"""Options that each shot says itself."""


def bake_shots(
    options: argparse.Namespace,
    reporter: Reporter,
    open_scene: OpenScene,
    bake: Bake,
    words_of: Callable[[Exception], str],
) -> int:
    """Traces shots of the scene's list one after the other, and writes the list of what is baked for the native
    program. One that fails keeps no other from being traced; all are named in the end. Shots of one frame, view layer
    and size follow each other: their scene is read once, where nothing depends on the camera. The panel names each
    shot's folder itself, and writes the list. Returns the exit code."""
    if given := [f"--{name.replace('_', '-')}" for name in OF_SHOTS if getattr(options, name) is not None]:
        raise UsageError(f"{', '.join(given)}: each shot of the list says that itself; leave it out beside --shots")
    _know_the_list()
    scene = open_scene(options, reporter)
    found, folders = shot_list.all_shots(scene), json.loads(options.folders or "{}")
    if folders:
        wanted = found = [replace(shot, folder=Path(folders[shot.name])) for shot in found if shot.name in folders]
    else:
        found = [_in_folder(shot, options.out) for shot in found]
        wanted = [shot for shot in shots.chosen(found, options.shots) if not shot.is_foreign]
    problems = _problems(scene, found) if options.out or folders else shot_list.problems(scene)
    baked: list[str] = []
    failures: dict[str, str] = {}
    camera, frame = scene.camera, scene.frame_current
    readings = _Readings(wanted)
    try:
        for number, shot in enumerate(readings.in_turn()):
            about = {"done": number, "total": len(wanted), "remaining_s": None, "message": shot.name}
            reporter.progress({"stage": "shots", **about, "baked": baked})
            try:
                if words := problems.get(shot.key):
                    raise ExportError(words)
                bake(scene, _options_of(scene, options, shot, frame), reporter, partial(readings.load, shot))
                baked.append(shot.name)
            except Exception as error:
                failures[shot.name] = words_of(error)
    finally:
        scene.camera = camera
        _show_frame(scene, frame)
    file = None if folders else Path(options.out) / LIST_FILE if options.out else shot_list.file_of(scene)
    names = shots.write_file(found, file, bpy.data.filepath) if file else []
    baked = [shot.name for shot in wanted if shot.name in baked]
    result = {"shots": str(file) if names else None, "baked": baked, "failed": failures}
    reporter.result(result, f"{file or scene.name}: {len(baked)} of {len(wanted)} shots baked")
    if failures:
        reporter.error("; ".join(f"shot '{name}': {reason}" for name, reason in failures.items()))
        return 1
    return 0


class _Readings:
    """Scenes of shots, each read once for all cameras that see the same."""

    def __init__(self, wanted: list[ListedShot]):
        self._by_state: dict[Any, list[ListedShot]] = {}
        for shot in wanted:
            self._by_state.setdefault(shot.state, []).append(shot)
        self._kept: tuple[Any, Any, dict[str, str]] | None = None
        """State of the newest scene, the scene, and the descriptions of cameras that see the same."""

    def in_turn(self) -> list[ListedShot]:
        """All shots, those with the same scene after each other."""
        return [shot for found in self._by_state.values() for shot in found]

    def load(self, shot: ListedShot, scene: bpy.types.Scene, options: ExportOptions) -> Any:
        """The scene of a shot, which Blender's scene shows now."""
        if self._kept is not None and self._kept[0] == shot.state and shot.camera in self._kept[2]:
            return self._kept[1].seen_by(self._kept[2][shot.camera])
        self._kept = None  # The memory of one scene is enough.
        others = tuple(other.camera for other in self._by_state[shot.state] if other.camera != shot.camera)
        read, cameras = load_scene_for(scene, replace(options, others=others))
        self._kept = (shot.state, read, cameras) if cameras else None
        return read


def _know_the_list() -> None:
    """Makes Blender know the properties that hold the list, where the add-on is not enabled."""
    from .ui import settings
    from .ui.shots import settings as shot_settings

    for name, module in {"relume": settings, "relume_shots": shot_settings}.items():
        if not hasattr(bpy.types.Scene, name):
            module.register()


def _show_frame(scene: bpy.types.Scene, frame: int) -> None:
    if scene.frame_current != frame:
        scene.frame_set(frame)


def _in_folder(shot: ListedShot, out: str | None) -> ListedShot:
    """The shot in a folder of its own below the one of --out; a bake of another file stays where it is."""
    if out is None or shot.is_foreign:
        return shot
    return replace(shot, folder=Path(out).absolute() / (shot.key or "shot"))


def _problems(scene: bpy.types.Scene, found: list[ListedShot]) -> dict[str, str]:
    cameras = {obj.name for obj in scene.objects if obj.type == "CAMERA"}
    return shots.problems(found, cameras, set(scene.view_layers.keys()), {})


def _options_of(
    scene: bpy.types.Scene, options: argparse.Namespace, shot: ListedShot, frame: int
) -> argparse.Namespace:
    """The options for one shot, whose camera, frame and view layer the scene takes. `frame` is the present one."""
    entry = next((entry for entry in entries(scene) if entry.key == shot.key), None)
    scene.camera = scene.objects[shot.camera]
    _show_frame(scene, shot.frame if shot.frame is not None else frame)
    force_layer(scene, shot.layer)
    samples = options.samples if options.samples is not None or entry is None else options_of(scene, entry).samples
    chosen = {"out": str(shot.folder), "camera": shot.camera, "samples": samples, "resolution": shot.size}
    return argparse.Namespace(**{**vars(options), **chosen})
