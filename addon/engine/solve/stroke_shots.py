"""Shots that strokes are painted in: a solve looks at each of them, in its own bake."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy

from ...core.shots import AUTOMATIC
from ...core.solve import SolveError
from ...core.strokes import Stroke
from ...export.current_shot import current_entry, entries
from ..shot import listed_view, shot_list
from ..shot.shot import Shot

INSTEAD = "or clear its strokes"


@dataclass(frozen=True)
class SolveView:
    """A shot that a solve looks at."""

    name: str
    """Empty for the current one."""
    folder: Path
    """Its bake."""
    strokes: tuple[Stroke, ...]


def key_of(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> str | None:
    """Key of the shot whose picture is seen through a camera; None if the camera is that of no shot."""
    if camera is None or camera == scene.camera:
        entry = current_entry(scene)
        return AUTOMATIC if entry is None else entry.key
    entry = listed_view.entry_of(scene, camera)
    return None if entry is None else entry.key


def strokes_in(scene: bpy.types.Scene, strokes: tuple[Stroke, ...], key: str) -> tuple[Stroke, ...]:
    """The strokes of one shot. Those that were painted where there was no list are of the current one."""
    own = {key, AUTOMATIC} if key == key_of(scene, scene.camera) else {key}
    return tuple(stroke for stroke in strokes if stroke.shot in own)


def views_of(scene: bpy.types.Scene, shot: Shot, strokes: tuple[Stroke, ...]) -> list[SolveView]:
    """The current shot, and all others of the list that are painted in. Raises SolveError where one has no bake, or is
    of another frame or view layer."""
    current = key_of(scene, scene.camera) or AUTOMATIC
    views = [SolveView("", shot.folder, strokes_in(scene, strokes, current))]
    for entry in entries(scene):
        own = strokes_in(scene, strokes, entry.key)
        if not own or entry.key == current:
            continue
        if words := listed_view.other_state(scene, entry, shot.lights.view_layer):
            raise SolveError(f"Shot '{entry.name}' {words}, {INSTEAD}")
        folder = shot_list.baked_folder(scene, entry)
        if folder is None:
            raise SolveError(f"Shot '{entry.name}' has no bake yet: press Bake All in the panel Shots, {INSTEAD}")
        views.append(SolveView(entry.name, folder, own))
    return views
