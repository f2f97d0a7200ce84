"""Parameters of a light that may change because nothing stands in the way of writing them back."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import bpy

from ..export.lights import name_of
from .look_lights import why_not_placed
from .writable import why_not

PATHS = {
    "size": ("shadow_soft_size", "size", "size_y", "angle"),
    "cone": ("spot_size", "spot_blend"),
    "color": ("color",),
    "strength": ("energy",),
}
"""Properties of the light's data; the others are the object's place."""


class FreeMoves:
    """Parameters that may change of the lights of a scene."""

    def __init__(self, scene: bpy.types.Scene, lights: Iterable[bpy.types.Object], instanced: Iterable[str]):
        """`instanced` are the names of those that are shown in other places than their own."""
        lights = set(lights)
        self._instanced = set(instanced)
        self._users = Counter(obj.data for obj in lights)
        self._carriers = _carriers(scene, lights)

    def of(self, obj: bpy.types.Object, moves: Iterable[str]) -> tuple[str | None, list[str]]:
        """Reason why some parameters cannot be written, to be put behind the light's name, and the others."""
        if name_of(obj) in self._instanced:
            return "is shown by instances", []
        place = why_not_placed(obj) or self._carriers.get(obj)
        shared = f"shares its data '{obj.data.name}' with other lights" if self._users[obj.data] > 1 else None
        reason, writable = None, []
        for move in moves:
            paths = PATHS.get(move)
            problem = place if paths is None else shared or why_not(obj.data, *paths)
            reason = reason or problem
            if problem is None:
                writable.append(move)
        return reason, writable


def _carriers(scene: bpy.types.Scene, lights: set[bpy.types.Object]) -> dict[bpy.types.Object, str]:
    """Lights that must stay because of objects below them, and why: geometry, which the bake holds where it is now, and
    lights that could not be put back into their places."""
    carriers: dict[bpy.types.Object, str] = {}
    for obj in scene.objects:
        reason = _needs_its_place(obj) if obj.parent else None
        above = obj.parent if reason else None
        while above is not None:
            if above in lights:
                carriers.setdefault(above, f"carries '{obj.name}', which {reason}")
            above = above.parent
    return carriers


def _needs_its_place(obj: bpy.types.Object) -> str | None:
    if obj.type == "LIGHT":
        return why_not_placed(obj)
    if obj.hide_render or (obj.type == "EMPTY" and obj.instance_type == "NONE"):
        return None
    return "would move in the scene, but not in the bake"
