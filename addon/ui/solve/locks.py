"""Locks of the parameters of lights and the world: operators, and their buttons in rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
from bpy.props import EnumProperty, StringProperty

from ...core.rows import GROUP, LIGHT, WORLD
from ...core.solve import LACKING, PARAMETERS, parameters_of
from ...export.light_tree import light_objects
from ...export.lights import name_of
from ...live import rows
from ..rows import RelumeRow

ICONS = {
    "position": "EMPTY_ARROWS",
    "direction": "ORIENTATION_GIMBAL",
    "size": "FULLSCREEN_ENTER",
    "cone": "LIGHT_SPOT",
    "color": "COLOR",
    "strength": "LIGHT_SUN",
}
TEXTS = {name: name.capitalize() for name in PARAMETERS} | {"color": "Colour"}
"""Labels of parameters, without the word "World" in the world's own row."""
LOCKED, UNLOCKED, PARTLY = "LOCKED", "UNLOCKED", "VIEW_UNLOCKED"
"""Icons of locks. One that is open for some parameters is bolder than one that is open for all."""
COLUMNS = 3
"""Number of locks beside each other in a narrow side bar."""


def _lock_all_text(move: str) -> str:
    name = "colour" if move == "color" else move
    return f"Let solving change the {name} of all lights, or of none. Lights that are locked as a whole stay locked"


LOCK_ALL_ITEMS = [(name, name.capitalize(), _lock_all_text(name)) for name in PARAMETERS]
"""Items of the operator. Not in the annotation: there Python 3.11, as of Blender 4.2, knows no names of the module in a
comprehension."""


def toggle_all(scene: bpy.types.Scene, parameter: str) -> None:
    """Locks a parameter of all lights that have it; frees it if it is locked everywhere."""
    names = {name_of(obj) for obj in light_objects(scene) if parameter not in LACKING[obj.data.type]}
    all_locks = [row.locks for row in rows.present_rows(scene) if row.kind == LIGHT and row.name in names]
    frees = not any(getattr(locks, parameter) for locks in all_locks)
    for locks in all_locks:
        setattr(locks, parameter, frees)


class RELUME_OT_lock_all(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Lock this of all lights, or unlock it if all are locked"""

    bl_idname = "relume.lock_all"
    bl_label = "Lock All"
    bl_options = {"REGISTER", "UNDO"}

    move: EnumProperty(
        name="What",
        description="What is locked or unlocked",
        items=LOCK_ALL_ITEMS,
    )

    @classmethod
    def description(cls, _context, properties):
        """The tooltip."""
        return _lock_all_text(properties.move)

    def execute(self, context):
        """Called by Blender."""
        toggle_all(context.scene, self.move)
        return {"FINISHED"}


@dataclass(frozen=True)
class _ShownLocks:
    """Locks of a row as they are shown."""

    owner: bpy.types.PropertyGroup
    prefix: str
    parameters: tuple[str, ...]
    """Parameters that can be locked; none of a light that is linked, which cannot be changed."""

    @property
    def icon(self) -> str:
        """Icon of the row's lock: closed, open, or open only in part."""
        free = [name for name in self.parameters if getattr(self.owner, self.prefix + name)]
        if not free or getattr(self.owner, f"{self.prefix}locked"):
            return LOCKED
        return UNLOCKED if len(free) == len(self.parameters) else PARTLY


def _locks_of(scene: bpy.types.Scene, row: RelumeRow) -> _ShownLocks | None:
    """Locks of a row; None if it has none."""
    if row.kind == WORLD:
        return _ShownLocks(scene.relume_solve, "world_", ("color", "strength"))
    if row.kind != LIGHT:
        return None
    kind = kind_of(row)
    return _ShownLocks(row.locks, "", tuple(parameters_of(kind)) if kind else ())


def kind_of(row: RelumeRow) -> str | None:
    """Type of a row's light; None if it is linked."""
    obj = bpy.data.objects.get((row.name, None))
    return obj.data.type if obj is not None and obj.type == "LIGHT" else None


def _locks_in(scene: bpy.types.Scene, group: str) -> Iterator[_ShownLocks]:
    """Locks of all lights of a collection that can be changed."""
    for row in rows.present_rows(scene):
        if row.kind == LIGHT and group in row.groups.split("\n"):
            locks = _locks_of(scene, row)
            if locks is not None and locks.parameters:
                yield locks


def _icon_of_group(scene: bpy.types.Scene, group: str) -> str | None:
    """Icon of all lights of a collection; None if none of them can be changed."""
    shared = None
    for locks in _locks_in(scene, group):
        icon = locks.icon
        if icon == PARTLY or shared not in {None, icon}:
            return PARTLY
        shared = icon
    return shared


def toggle_group(scene: bpy.types.Scene, group: str) -> None:
    """Locks all lights of a collection; unlocks them if all are locked."""
    all_locks = list(_locks_in(scene, group))
    locks_all = any(locks.icon != LOCKED for locks in all_locks)
    for locks in all_locks:
        locks.owner.locked = locks_all


class RELUME_OT_lock_group(bpy.types.Operator):  # noqa: N801
    """Lock all lights of this collection, or unlock them if all are locked. A closed lock: solving leaves all of them \
as they are. A bold open one: some of them, or something of them, is locked"""

    bl_idname = "relume.lock_group"
    bl_label = "Lock Group"
    bl_options = {"REGISTER", "UNDO"}

    group: StringProperty(name="Group", description="Name of the collection", options={"SKIP_SAVE"})

    def execute(self, context):
        """Called by Blender."""
        toggle_group(context.scene, self.group)
        return {"FINISHED"}


def draw_lock(layout, scene: bpy.types.Scene, row: RelumeRow) -> None:
    """Draws the lock of a row as a whole, or a gap of the same width where there is none."""
    if row.kind == GROUP:
        icon = _icon_of_group(scene, row.name)
        cell = layout.row(align=True)
        cell.enabled = icon is not None
        cell.operator("relume.lock_group", text="", icon=icon or LOCKED, emboss=False).group = row.name
        return
    locks = _locks_of(scene, row)
    if locks is None:
        layout.label(text="", icon="BLANK1")
        return
    cell = layout.row(align=True)
    cell.enabled = bool(locks.parameters)
    cell.prop(locks.owner, f"{locks.prefix}locked", text="", icon=locks.icon, emboss=False)


def draw_parameters(layout, scene: bpy.types.Scene, row: RelumeRow) -> None:
    """Draws the locks of the parameters of a row."""
    locks = _locks_of(scene, row)
    if locks is None or not locks.parameters:
        return
    grid = layout.grid_flow(row_major=True, columns=min(len(locks.parameters), COLUMNS), align=True)
    grid.enabled = not (row.kind == LIGHT and row.locks.held)
    for parameter in locks.parameters:
        name = locks.prefix + parameter
        icon = UNLOCKED if getattr(locks.owner, name) else LOCKED
        grid.prop(locks.owner, name, text=TEXTS[parameter], icon=icon, toggle=True)


def draw_all(layout) -> None:
    """Draws a switch for each parameter of all lights."""
    line = layout.row(align=True)
    line.label(text="All Lights")
    for name in PARAMETERS:
        line.operator("relume.lock_all", text="", icon=ICONS[name]).move = name


CLASSES = (RELUME_OT_lock_all, RELUME_OT_lock_group)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
