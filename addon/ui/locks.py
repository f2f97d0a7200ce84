"""What solving may change of lights and the world: the locks of the rows, less what could not be written back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import bpy
from bpy.props import EnumProperty, StringProperty

from ..apply.free_moves import FreeMoves
from ..core.rows import GROUP, LIGHT
from ..core.rows import WORLD as WORLD_ROW
from ..core.solve import WORLD
from ..engine.shot import shot
from ..export.lights import name_of
from . import looks, rows
from .solve_settings import MOVES

HAS_NOT = {
    "POINT": {"direction", "cone"},
    "SPOT": set(),
    "AREA": {"cone"},
    "SUN": {"position", "cone"},
}
"""What a type of light does not have."""
ICONS = {
    "position": "EMPTY_ARROWS",
    "direction": "ORIENTATION_GIMBAL",
    "size": "FULLSCREEN_ENTER",
    "cone": "LIGHT_SPOT",
    "color": "COLOR",
    "strength": "LIGHT_SUN",
}
TEXTS = {move: move.capitalize() for move in MOVES} | {"color": "Colour"}
"""Those of the world are not called the world's, in its own row."""
LOCKED, UNLOCKED, PARTLY = "LOCKED", "UNLOCKED", "VIEW_UNLOCKED"
"""Icons of locks. One that is open for some parameters is bolder than one that is open for all."""
COLUMNS = 3
"""Of locks beside each other in a narrow side bar."""


def moves_of(kind: str) -> list[str]:
    """What a type of light has that could be free."""
    return [move for move in MOVES if move not in HAS_NOT[kind]]


def free(scene: bpy.types.Scene, lights: Iterable[str]) -> tuple[dict[str, list[str]], list[str]]:
    """What is unlocked, by the names of lights in the picture and WORLD; and why some of it stays locked anyway."""
    lights, settings = list(lights), scene.relume_solve
    objects = {name_of(obj): obj for obj in looks.lights_of(scene)}
    found = shot.of(scene)
    moves = FreeMoves(scene, objects.values(), found.lights.instanced if found is not None else ())
    out: dict[str, list[str]] = {}
    notes = []
    for row in rows.present_rows(scene):
        if row.kind != LIGHT or row.name not in lights or row.name not in objects:
            continue
        obj = objects[row.name]
        wanted = [] if row.locks.held else [move for move in moves_of(obj.data.type) if getattr(row.locks, move)]
        reason, kept = moves.of(obj, wanted)
        if reason and wanted:
            notes.append(f"light '{row.name}' {reason}: that stays as it is")
        out[row.name] = kept
    out[WORLD] = [move for move in ("color", "strength") if scene.world and getattr(settings, f"world_{move}")]
    return out, notes


def _lock_all_text(move: str) -> str:
    what = "colour" if move == "color" else move
    return f"Let solving change the {what} of all lights, or of none. Lights that are locked as a whole stay locked"


LOCK_ALL_ITEMS = [(move, move.capitalize(), _lock_all_text(move)) for move in MOVES]
"""Not in the annotation: Python 3.11, as of Blender 4.2, finds no names of the module in a comprehension there."""


def toggle_all(scene: bpy.types.Scene, move: str) -> None:
    """Locks a move of all lights that have it; frees it if it is locked everywhere."""
    has_it = {name_of(obj) for obj in looks.lights_of(scene) if move not in HAS_NOT[obj.data.type]}
    found = [row.locks for row in rows.present_rows(scene) if row.kind == LIGHT and row.name in has_it]
    frees = not any(getattr(locks, move) for locks in found)
    for locks in found:
        setattr(locks, move, frees)


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
class _Locks:
    """The locks of a row as they are shown."""

    owner: bpy.types.PropertyGroup
    prefix: str
    moves: tuple[str, ...]
    """What there is to be locked; nothing of a light that is linked, which cannot be changed."""

    @property
    def icon(self) -> str:
        """Of the row's lock: closed, open, or open only in part."""
        free = [move for move in self.moves if getattr(self.owner, self.prefix + move)]
        if not free or getattr(self.owner, f"{self.prefix}locked"):
            return LOCKED
        return UNLOCKED if len(free) == len(self.moves) else PARTLY


def _locks_of(scene: bpy.types.Scene, row: rows.RelumeRow) -> _Locks | None:
    """None for what has no locks."""
    if row.kind == WORLD_ROW:
        return _Locks(scene.relume_solve, "world_", ("color", "strength"))
    if row.kind != LIGHT:
        return None
    kind = kind_of(row)
    return _Locks(row.locks, "", tuple(moves_of(kind)) if kind else ())


def kind_of(row: rows.RelumeRow) -> str | None:
    """The type of a row's light; None of what is linked. Costs nothing."""
    obj = bpy.data.objects.get((row.name, None))
    return obj.data.type if obj is not None and obj.type == "LIGHT" else None


def _locks_in(scene: bpy.types.Scene, group: str) -> Iterator[_Locks]:
    """The locks of all lights of a collection that can be changed."""
    for row in rows.present_rows(scene):
        if row.kind == LIGHT and group in row.groups.split("\n"):
            found = _locks_of(scene, row)
            if found is not None and found.moves:
                yield found


def _icon_of_group(scene: bpy.types.Scene, group: str) -> str | None:
    """The icon of all its lights; None where none of them can be changed."""
    shared = None
    for found in _locks_in(scene, group):
        icon = found.icon
        if icon == PARTLY or shared not in {None, icon}:
            return PARTLY
        shared = icon
    return shared


def toggle_group(scene: bpy.types.Scene, group: str) -> None:
    """Locks all lights of a collection; unlocks them if all are locked."""
    found = list(_locks_in(scene, group))
    locks_all = any(locks.icon != LOCKED for locks in found)
    for locks in found:
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


def draw_lock(layout, scene: bpy.types.Scene, row: rows.RelumeRow) -> None:
    """The lock of a row as a whole; as wide where there is none."""
    if row.kind == GROUP:
        icon = _icon_of_group(scene, row.name)
        cell = layout.row(align=True)
        cell.enabled = icon is not None
        cell.operator("relume.lock_group", text="", icon=icon or LOCKED, emboss=False).group = row.name
        return
    found = _locks_of(scene, row)
    if found is None:
        layout.label(text="", icon="BLANK1")
        return
    cell = layout.row(align=True)
    cell.enabled = bool(found.moves)
    cell.prop(found.owner, f"{found.prefix}locked", text="", icon=found.icon, emboss=False)


def draw_parameters(layout, scene: bpy.types.Scene, row: rows.RelumeRow) -> None:
    """The locks of the parameters of a row."""
    found = _locks_of(scene, row)
    if found is None or not found.moves:
        return
    grid = layout.grid_flow(row_major=True, columns=min(len(found.moves), COLUMNS), align=True)
    grid.enabled = not (row.kind == LIGHT and row.locks.held)
    for move in found.moves:
        name = found.prefix + move
        icon = UNLOCKED if getattr(found.owner, name) else LOCKED
        grid.prop(found.owner, name, text=TEXTS[move], icon=icon, toggle=True)


def draw_all(layout) -> None:
    """A switch for each parameter of all lights."""
    line = layout.row(align=True)
    line.label(text="All Lights")
    for move in MOVES:
        line.operator("relume.lock_all", text="", icon=ICONS[move]).move = move


CLASSES = (RELUME_OT_lock_all, RELUME_OT_lock_group)


def register():
    """Adds the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
