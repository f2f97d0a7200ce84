"""How far lights may go: what the panel shows of it, and what is asked for."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector

from ..core import solve as core
from ..core.rows import LIGHT
from . import rows
from .solve_settings import Limits


def of(settings: Limits, stay: float | None) -> core.Limits:
    """The limits of all lights, or of one. Raises SolveError if a box holds nothing."""
    stops = (-settings.darker, settings.brighter) if settings.limit_strength else None
    degrees = math.degrees(settings.turn) if settings.limit_turn else None
    return core.Limits(_box_of(settings.box), stops, degrees, stay)


def of_each(scene: bpy.types.Scene, free: dict[str, list[str]]) -> dict[str, core.Limits]:
    """The own limits of lights with something free, by their names. Raises SolveError if a box holds nothing."""
    lights = [row for row in rows.present_rows(scene) if row.kind == LIGHT and free.get(row.name)]
    return {row.name: of(row.locks, row.locks.stay if row.locks.own_stay else None) for row in lights}


def draw(layout, settings: Limits) -> None:
    """Buttons of the limits but for what draws lights back."""
    layout.prop(settings, "box")
    layout.prop(settings, "limit_strength")
    if settings.limit_strength:
        line = layout.row(align=True)
        line.prop(settings, "darker")
        line.prop(settings, "brighter")
    layout.prop(settings, "limit_turn")
    if settings.limit_turn:
        layout.prop(settings, "turn")


def _box_of(obj: bpy.types.Object | None) -> tuple[list[float], list[float]] | None:
    """Corners of the box around an object, in the world."""
    if obj is None:
        return None
    corners = np.array([obj.matrix_world @ Vector(corner) for corner in obj.bound_box])
    low, high = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    if not all(one < other for one, other in zip(low, high, strict=True)):
        raise core.SolveError(
            f"'{obj.name}' is flat, so no light can be within it: give it a height, or choose another box"
        )
    return low, high
