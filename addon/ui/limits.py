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

NUMBERS = {
    "limit_strength": ("darker", "brighter"),
    "limit_tint": ("tint",),
    "limit_turn": ("turn",),
    "limit_size": ("smallest", "largest"),
    "limit_sun": ("sun_least", "sun_most"),
    "limit_cone": ("cone_least", "cone_most"),
}
"""Switches of limits, and the values that they switch on."""
WITHOUT = {
    "box": {"SUN"},
    "limit_turn": {"POINT"},
    "limit_size": {"SUN"},
    "limit_sun": {"POINT", "SPOT", "AREA"},
    "limit_cone": {"POINT", "AREA", "SUN"},
}
"""Types of light of which a limit says nothing."""


def of(settings: Limits, stay: float | None) -> core.Limits:
    """The limits of all lights, or of one. Raises SolveError if a box or a range holds nothing."""
    stops = (-settings.darker, settings.brighter) if settings.limit_strength else None
    tint = settings.tint if settings.limit_tint else None
    degrees = math.degrees(settings.turn) if settings.limit_turn else None
    size = _range(settings, "limit_size", "size")
    sun, cone = _range(settings, "limit_sun", "angle of a sun"), _range(settings, "limit_cone", "cone of a spot")
    return core.Limits(_box_of(settings.box), stops, tint, degrees, size, _halved(sun), _halved(cone), stay)


def _range(settings: Limits, switch: str, what: str) -> tuple[float, float] | None:
    if not getattr(settings, switch):
        return None
    low, high = (getattr(settings, name) for name in NUMBERS[switch])
    if low >= high:
        raise core.SolveError(f"The limits of the {what} leave nothing: the first must be below the second")
    return low, high


def _halved(angles: tuple[float, float] | None) -> tuple[float, float] | None:
    """Blender's angles are from edge to edge."""
    return angles and (0.5 * angles[0], 0.5 * angles[1])


def of_each(scene: bpy.types.Scene, free: dict[str, list[str]]) -> dict[str, core.Limits]:
    """The own limits of lights with something free, by their names. Raises SolveError if a box or a range
    holds nothing."""
    lights = [row for row in rows.present_rows(scene) if row.kind == LIGHT and free.get(row.name)]
    return {row.name: of(row.locks, row.locks.stay if row.locks.own_stay else None) for row in lights}


def draw(layout, settings: Limits, kind: str | None = None) -> None:
    """Buttons of the limits but for what draws lights back: those for a type of light, or for all."""
    if kind not in WITHOUT["box"]:
        layout.prop(settings, "box")
    for switch, numbers in NUMBERS.items():
        if kind in WITHOUT.get(switch, ()):
            continue
        layout.prop(settings, switch)
        if getattr(settings, switch):
            line = layout.row(align=True)
            for number in numbers:
                line.prop(settings, number)


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
