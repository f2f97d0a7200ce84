"""Settings of a solve that a scene keeps, `scene.relume_solve` and the locks of its rows, as plain data."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ...apply.free_moves import FreeMoves
from ...core import strokes as core_strokes
from ...core.rows import LIGHT
from ...core.solve import EFFORTS, WORLD, Limits, SolveError, SolveOptions, parameters_of
from ...core.strokes import Stroke, StrokeError
from ...export.light_tree import light_objects
from ...export.lights import name_of
from ..shot import shot as shots
from .region_masks import KINDS, MaskSubject

WHOLE = "WHOLE"
"""Place of a target that counts in the whole picture."""
LEAST = 0.005
"""Least width and height of a rectangle, as a share of the picture's."""
TARGET = "target"
"""Name of the target's image in a request."""


@dataclass
class Inputs:
    """Settings of a solve, with the pictures that they refer to."""

    options: SolveOptions
    """All settings but the goals of strokes, which are made on a thread."""
    strokes: tuple[Stroke, ...]
    images: dict[str, bpy.types.Image]
    """Masks to read, by their names in the request."""
    subjects: dict[str, MaskSubject]
    """Objects and materials whose masks are to be made, by the names of the masks in the request."""
    notes: list[str]
    """Sentences for the artist about what stays locked."""


def inputs_of(scene: bpy.types.Scene, content: dict[str, Any]) -> Inputs:
    """Inputs of a solve that starts at a picture, `content` of its request. Raises SolveError."""
    free, notes = free_parameters(scene, [light["name"] for light in content["lights"]])
    for name, gain in content["gains"].items():
        if not any(gain):  # What is switched off stays off.
            free.pop(name, None)
    places = _Places()
    settings = scene.relume_solve
    goals = [*_region_goals(settings, places), *_target_goals(settings, places)]
    starts, steps = EFFORTS[settings.effort]
    options = SolveOptions(
        free,
        goals,
        keep_rest=settings.keep_rest,
        limits=limits_of(settings, settings.stay),
        per_light=limits_per_light(scene, free),
        add_count=settings.add_count,
        add_type=settings.add_type,
        remove=settings.remove,
        starts=starts,
        steps=steps,
    )
    return Inputs(options, strokes_of(scene), places.images, places.subjects, notes)


def strokes_of(scene: bpy.types.Scene) -> tuple[Stroke, ...]:
    """Strokes of a scene; none if they cannot be read, such as those of a newer Relume."""
    return _strokes_in(scene.relume_solve.strokes)


@functools.lru_cache(maxsize=8)
def _strokes_in(text: str) -> tuple[Stroke, ...]:
    """Strokes of a scene's text. Kept, since every drawing asks for them."""
    try:
        return core_strokes.from_json(text)
    except StrokeError:
        return ()


def free_parameters(scene: bpy.types.Scene, lights: Iterable[str]) -> tuple[dict[str, list[str]], list[str]]:
    """Unlocked parameters, by the names of lights in the picture and WORLD, and reasons why some stay locked anyway."""
    names, settings = set(lights), scene.relume_solve
    objects = {name_of(obj): obj for obj in light_objects(scene)}
    shot = shots.of(scene)
    moves = FreeMoves(scene, objects.values(), shot.lights.instanced if shot is not None else ())
    free: dict[str, list[str]] = {}
    notes = []
    for row in _light_rows(scene):
        if row.name not in names or row.name not in objects:
            continue
        obj = objects[row.name]
        unlocked = [] if row.locks.held else [it for it in parameters_of(obj.data.type) if getattr(row.locks, it)]
        reason, writable = moves.of(obj, unlocked)
        if reason and unlocked:
            notes.append(f"light '{row.name}' {reason}: that stays as it is")
        free[row.name] = writable
    free[WORLD] = [it for it in ("color", "strength") if scene.world and getattr(settings, f"world_{it}")]
    return free, notes


def _light_rows(scene: bpy.types.Scene) -> list[Any]:
    """Rows of the lights that the scene has now."""
    return [row for row in scene.relume_mix.rows if row.present and row.kind == LIGHT]


def limits_of(settings: Any, stay: float | None) -> Limits:
    """Limits of all lights, or of one; `settings` are `ui.solve.settings.LimitSettings`. Raises SolveError if a box or
    a range holds nothing."""
    stops = (-settings.darker, settings.brighter) if settings.limit_strength else None
    tint = settings.tint if settings.limit_tint else None
    degrees = math.degrees(settings.turn) if settings.limit_turn else None
    size = _range(settings.smallest, settings.largest, "size") if settings.limit_size else None
    sun = _range(settings.sun_least, settings.sun_most, "angle of a sun") if settings.limit_sun else None
    cone = _range(settings.cone_least, settings.cone_most, "cone of a spot") if settings.limit_cone else None
    return Limits(_box_around(settings.box), stops, tint, degrees, size, _halved(sun), _halved(cone), stay)


def limits_per_light(scene: bpy.types.Scene, free: dict[str, list[str]]) -> dict[str, Limits]:
    """Own limits of the lights with free parameters, by name. Raises SolveError if a box or a range holds nothing."""
    rows = [row for row in _light_rows(scene) if free.get(row.name)]
    return {row.name: limits_of(row.locks, row.locks.stay if row.locks.own_stay else None) for row in rows}


def _range(low: float, high: float, quantity: str) -> tuple[float, float]:
    if low >= high:
        raise SolveError(f"The limits of the {quantity} leave nothing: the first must be below the second")
    return low, high


def _halved(angles: tuple[float, float] | None) -> tuple[float, float] | None:
    """Angles from the axis; Blender's are from edge to edge."""
    return angles and (0.5 * angles[0], 0.5 * angles[1])


def _box_around(obj: bpy.types.Object | None) -> tuple[list[float], list[float]] | None:
    """Corners of the box around an object, in the world."""
    if obj is None:
        return None
    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    if not all(one < other for one, other in zip(low, high, strict=True)):
        raise SolveError(f"'{obj.name}' is flat, so no light can be within it: give it a height, or choose another box")
    return low, high


class _Places:
    """Collects the masks that the places of goals refer to."""

    def __init__(self) -> None:
        self.images: dict[str, bpy.types.Image] = {}
        self.subjects: dict[str, MaskSubject] = {}

    def place(self, region: Any, name: str, who: str, instead: str) -> dict[str, Any]:
        """Place of a region as a request has it; its mask, if it has one, is known by `name`. Raises SolveError, which
        says what `who` lacks and what to do `instead` of giving it."""
        if region.kind == "RECTANGLE":
            left, top, right, bottom = region.rectangle
            if right - left < LEAST or bottom - top < LEAST:
                raise SolveError(f"{who} has a rectangle without size: draw it again or {instead}")
            return {"rectangle": [left, top, right, bottom]}
        if region.kind == "MASK":
            if region.image is None:
                raise SolveError(f"{who} has no mask: choose an image or {instead}")
            self.images[name] = region.image
        else:
            self.subjects[name] = _subject_of(region, who, instead)
        return {"mask": name}


def _subject_of(region: Any, who: str, instead: str) -> MaskSubject:
    assert region.kind in KINDS
    if region.kind.endswith("INDEX"):
        return MaskSubject(region.kind, region.index)
    block = region.object if region.kind == "OBJECT" else region.material
    if block is None:
        raise SolveError(f"{who} has no {region.kind.lower()}: choose one or {instead}")
    return MaskSubject(region.kind, block.name)


def _region_goals(settings: Any, places: _Places) -> list[dict[str, Any]]:
    goals = []
    for number, region in enumerate(settings.regions, 1):
        place = places.place(region, f"mask {number}", "A region", "remove the region")
        goals.append(region.meaning().plain() | {"where": place})
    return goals


def _target_goals(settings: Any, places: _Places) -> list[dict[str, Any]]:
    if settings.target is None:
        return []
    invariant, weight = settings.target_exposure, settings.target_weight
    goal = {"goal": "target", "image": TARGET, "exposure_invariant": invariant, "weight": weight}
    if settings.target_place.kind == WHOLE:
        return [goal]
    instead = "let it count in the whole picture"
    return [goal | {"where": places.place(settings.target_place, "mask of the target", "The target's place", instead)}]
