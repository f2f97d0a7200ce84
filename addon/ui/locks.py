"""What solving may change of each light: the locks of the rows, less what could not be written back."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
from bpy.props import EnumProperty

from ..apply.free_moves import FreeMoves
from ..core.rows import LIGHT
from ..core.solve import WORLD
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


def moves_of(kind: str) -> list[str]:
    """What a type of light has that could be free."""
    return [move for move in MOVES if move not in HAS_NOT[kind]]


def free(scene: bpy.types.Scene, lights: Iterable[str]) -> tuple[dict[str, list[str]], list[str]]:
    """What is unlocked, by the names of lights in the picture and WORLD; and why some of it stays locked anyway."""
    lights, settings = list(lights), scene.relume_solve
    objects = {name_of(obj): obj for obj in looks.lights_of(scene)}
    moves = FreeMoves(scene, objects.values(), lights)
    out: dict[str, list[str]] = {}
    notes = []
    for row in rows.present_rows(scene):
        if row.kind != LIGHT or row.name not in lights or row.name not in objects:
            continue
        obj = objects[row.name]
        wanted = [move for move in moves_of(obj.data.type) if getattr(row.locks, move)]
        reason, kept = moves.of(obj, wanted)
        if reason and wanted:
            notes.append(f"light '{row.name}' {reason}: that stays as it is")
        out[row.name] = kept
    out[WORLD] = [move for move in ("color", "strength") if scene.world and getattr(settings, f"world_{move}")]
    return out, notes


def _lock_all_text(move: str) -> str:
    return f"Let solving change the {'colour' if move == 'color' else move} of all lights, or of none"


LOCK_ALL_ITEMS = [(move, move.capitalize(), _lock_all_text(move)) for move in MOVES]
"""Not in the annotation: Python 3.11, as of Blender 4.2, finds no names of the module in a comprehension there."""


def toggle_all(scene: bpy.types.Scene, move: str) -> None:
    """Locks a move of all lights; frees it if it is locked everywhere."""
    found = [row for row in rows.present_rows(scene) if row.kind == LIGHT]
    frees = not any(getattr(row.locks, move) for row in found)
    for row in found:
        setattr(row.locks, move, frees)


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


class RELUME_UL_locks(bpy.types.UIList):  # noqa: N801
    """Lights, and what may change of each: pressed icons are free, the others locked"""

    def draw_item(self, _context, layout, _data, row, _icon, _active_data, _active_property):
        """Called by Blender."""
        line = layout.row(align=True)
        line.label(text=row.name, icon=row.icon)
        obj = _light_of(row)
        kind = obj.data.type if obj is not None else "SPOT"
        for move in MOVES:
            cell = line.row(align=True)
            cell.enabled = move not in HAS_NOT[kind]
            cell.prop(row.locks, move, text="", icon=ICONS[move])

    def filter_items(self, _context, data, name):
        """Called by Blender: which rows, and their order."""
        found = getattr(data, name)
        shown = [self.bitflag_filter_item if row.present and row.kind == LIGHT else 0 for row in found]
        return shown, [row.order for row in found]


def _light_of(row: rows.RelumeRow) -> bpy.types.Object | None:
    """The light of a row in this file; a linked one cannot be changed. Costs nothing."""
    obj = bpy.data.objects.get((row.name, None))
    return obj if obj is not None and obj.type == "LIGHT" else None


def active_row(scene: bpy.types.Scene) -> rows.RelumeRow | None:
    """The light that is chosen in the list."""
    mix = scene.relume_mix
    row = mix.rows[mix.active] if 0 <= mix.active < len(mix.rows) else None
    return row if row is not None and row.present and row.kind == LIGHT else None


def draw(layout, scene: bpy.types.Scene) -> None:
    """The list of locks, with a switch for all lights over each column."""
    mix, settings = scene.relume_mix, scene.relume_solve
    head = layout.row(align=True)
    head.label(text="May change")
    for move in MOVES:
        head.operator("relume.lock_all", text="", icon=ICONS[move]).move = move
    count = sum(row.kind == LIGHT for row in rows.present_rows(scene))
    layout.template_list("RELUME_UL_locks", "", mix, "rows", mix, "active", rows=max(2, min(count, 8)))
    active = active_row(scene)
    obj = _light_of(active) if active is not None else None
    if obj is not None:
        column = layout.column(align=True)
        for move in moves_of(obj.data.type):
            _lock(column, active.locks, move)
    if scene.world is not None:
        line = layout.row(align=True)
        line.label(text="World", icon="WORLD")
        _lock(line, settings, "world_strength", "Strength")
        _lock(line, settings, "world_color", "Colour")


def _lock(layout, owner, name: str, text: str | None = None) -> None:
    icon = "UNLOCKED" if getattr(owner, name) else "LOCKED"
    layout.prop(owner, name, icon=icon, toggle=True, **({} if text is None else {"text": text}))


CLASSES = (RELUME_OT_lock_all, RELUME_UL_locks)


def register():
    """Adds list and operator."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
