"""States of a look's lights: reading them, and restoring them."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import bpy
from mathutils import Matrix

from ..export.lights import name_of
from .writable import RefusedError, why_not

SETTINGS = (
    "energy",
    "color",
    "exposure",
    "normalize",
    "use_temperature",
    "temperature",
    "shadow_soft_size",
    "use_soft_falloff",
    "angle",
    "shape",
    "size",
    "size_y",
    "spread",
    "spot_size",
    "spot_blend",
)
"""Properties of a light that a look keeps, as far as its type and its Blender have them."""
PLACE = ("location", "rotation_euler", "rotation_quaternion", "rotation_axis_angle", "scale")
STRUCTS = {"POINT": "PointLight", "SPOT": "SpotLight", "AREA": "AreaLight", "SUN": "SunLight"}
"""Blender's class for each type of light."""
TOLERANCE = 1e-5
"""Tolerance of a matrix entry: Blender stores location, rotation and scale in 32 bits."""


def light_state(obj: bpy.types.Object) -> dict[str, Any]:
    """One light of a `core.looks.Look`."""
    light = obj.data
    return {
        "name": name_of(obj),
        "type": light.type,
        "matrix": [list(row) for row in obj.matrix_world],
        "hidden": obj.hide_render or obj.hide_viewport,
        "settings": {name: _plain(getattr(light, name)) for name in SETTINGS if hasattr(light, name)},
    }


def restore_lights(objects: Iterable[bpy.types.Object], states: Iterable[dict[str, Any]]) -> list[str]:
    """Restores lights, matched by name; returns the names that the scene lacks. Raises RefusedError, and has then
    written nothing."""
    objects, states = list(objects), list(states)
    reasons = refusals(objects, states)
    if reasons:
        raise RefusedError(reasons)
    has_moved = False
    for _, level in itertools.groupby(_matched(objects, states), lambda restore: _depth(restore.obj)):
        restores = list(level)
        if has_moved:  # A light is placed by where its parent is now.
            bpy.context.view_layer.update()
        for restore in restores:
            restore.write()
        has_moved |= any(restore.moves for restore in restores)
    names = {name_of(obj) for obj in objects}
    return [state["name"] for state in states if state["name"] not in names]


def refusals(objects: Iterable[bpy.types.Object], states: Iterable[dict[str, Any]]) -> list[str]:
    """Reasons why lights cannot be restored, a line each."""
    return [reason for restore in _matched(objects, states) for reason in restore.refusals()]


def why_not_placed(obj: bpy.types.Object) -> str | None:
    """Reason why an object's place cannot be written, to be put behind its name; None if it can."""
    reason = why_not(obj, *PLACE)
    if reason is None and obj.constraints:
        return f"is placed by its constraint '{obj.constraints[0].name}'"
    return reason


def _matched(objects: Iterable[bpy.types.Object], states: Iterable[dict[str, Any]]) -> list[_Restore]:
    """Restores of objects, parents before children: of lights with a state, and of others whose parent moves, which are
    to stay where they are."""
    by_name = {state["name"]: state for state in states}
    places: dict[bpy.types.Object, Matrix] = {}
    restores = []
    for obj in sorted(objects, key=_depth):
        state = by_name.get(name_of(obj))
        if state is None and _carrier(obj, places) is None:
            continue
        restores.append(_Restore(obj, state or light_state(obj), _carried(obj, places), is_kept=state is None))
        places[obj] = Matrix(restores[-1].state["matrix"])
    return restores


def _depth(obj: bpy.types.Object) -> int:
    return 0 if obj.parent is None else 1 + _depth(obj.parent)


def _carrier(obj: bpy.types.Object, places: dict[bpy.types.Object, Matrix]) -> bpy.types.Object | None:
    """The nearest of some objects that another hangs on."""
    above = obj.parent
    while above is not None and above not in places:
        above = above.parent
    return above


def _carried(obj: bpy.types.Object, places: dict[bpy.types.Object, Matrix]) -> Matrix:
    """Place of a light once its parents have got theirs."""
    carrier = _carrier(obj, places)
    if carrier is None or not _differ(carrier.matrix_world, places[carrier]):
        return obj.matrix_world.copy()
    return places[carrier] @ carrier.matrix_world.inverted_safe() @ obj.matrix_world


def _differ(matrix: Matrix, other: Matrix) -> bool:
    pairs = zip(matrix, other, strict=True)
    return any(abs(a - b) > TOLERANCE for row, other_row in pairs for a, b in zip(row, other_row, strict=True))


@dataclass
class _Restore:
    """Differences between a light and its state in a look."""

    obj: bpy.types.Object
    state: dict[str, Any]
    carried: Matrix
    """Place of the light if nothing is written to it."""
    is_kept: bool
    """True if the light is not in the look and only stays in its place."""
    settings: dict[str, Any] = field(init=False)
    moves: bool = field(init=False)
    hides: bool = field(init=False)
    retypes: bool = field(init=False)

    def __post_init__(self) -> None:
        now = light_state(self.obj)
        self.retypes = now["type"] != self.state["type"]
        # Another type has other settings: then all of them are written.
        before = {} if self.retypes else now["settings"]
        settings = {name: value for name, value in self.state["settings"].items() if name in SETTINGS}
        self.settings = {
            name: value
            for name, value in settings.items()
            if before.get(name) != value and name in _properties(self.state["type"])
        }
        self.hides = now["hidden"] != self.state["hidden"]
        self.moves = _differ(self.carried, Matrix(self.state["matrix"]))

    def refusals(self) -> list[str]:
        """Reasons why the light cannot be restored."""
        obj, light = self.obj, self.obj.data
        reasons = []
        if self.settings or self.retypes:
            reasons += [why_not(light, *self.settings), self._unfit()]
        if self.moves:
            reasons.append(why_not_placed(obj))
        if self.hides:
            reasons.append(why_not(obj, "hide_render", "hide_viewport"))
        subject = f"light '{obj.name}'" + (" hangs on a light that moves, and" if self.is_kept else "")
        return [f"{subject} {reason}" for reason in dict.fromkeys(reasons) if reason]

    def _unfit(self) -> str | None:
        """Values that the light cannot take, as a look may come from anywhere."""
        properties = _properties(self.state["type"])
        if not properties:
            return f"cannot be of type '{self.state['type']}'"
        for name, value in self.settings.items():
            if not _fits(properties[name], value):
                return f"cannot have {value!r} as its {name.replace('_', ' ')}"
        return None

    def write(self) -> None:
        """Writes all that differs."""
        obj = self.obj
        if self.retypes:
            obj.data.type = self.state["type"]
        for name, value in self.settings.items():
            setattr(obj.data, name, value)
        if self.moves:
            obj.matrix_world = Matrix(self.state["matrix"])
        if self.hides:
            obj.hide_render = obj.hide_viewport = self.state["hidden"]


def _plain(value: Any) -> Any:
    return value if isinstance(value, bool | int | float | str) else list(value)


def _properties(kind: str) -> Any:
    """The RNA properties of a type of light, by name; nothing for types that there are not."""
    return getattr(bpy.types, STRUCTS[kind]).bl_rna.properties if kind in STRUCTS else {}


def _fits(prop: bpy.types.Property, value: Any) -> bool:
    if prop.type == "BOOLEAN":
        return isinstance(value, bool)
    if prop.type == "ENUM":
        return isinstance(value, str) and value in prop.enum_items
    if getattr(prop, "array_length", 0):
        return isinstance(value, list) and len(value) == prop.array_length
    return isinstance(value, int | float) and not isinstance(value, bool)
