"""The mix of a scene, `scene.relume_mix`: a row for every light, every collection with lights, the world and the
light of emissive materials. The rows follow the scene by themselves; nothing here writes to a light.

The row of a light that is gone stays in the file, unseen, so that an undone deletion finds it with its values.
Rows are recognised by session uid, which outlives renaming and undo, and after a file is opened by name.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ..core import rows as core
from ..core.rows import GROUP, LIGHT, STATIC, WORLD
from ..export.light_tree import Line, is_light, light_tree
from ..export.lights import name_of
from .solve.settings import RelumeLocks

VALUES = ("on", "solo", "exposure", "multiplier", "color", "use_kelvin", "kelvin")
"""Properties of a row that the artist sets; the names are those of `core.rows.Row`."""
SESSION = uuid.uuid4().hex
"""Session uids mean something only within one run of Blender."""
LIGHT_ICONS = {"POINT": "LIGHT_POINT", "SUN": "LIGHT_SUN", "SPOT": "LIGHT_SPOT", "AREA": "LIGHT_AREA"}

_quiet = 0
_due: set[int] = set()
"""Scenes whose rows are to be compared."""
_mixes: dict[int, tuple[tuple, dict[str, Any]]] = {}
"""Newest mix of each scene, with all that it follows from."""


@contextmanager
def quiet() -> Iterator[None]:
    """Rows are written without a request for a picture."""
    global _quiet
    _quiet += 1
    try:
        yield
    finally:
        _quiet -= 1


def _edited(row: RelumeRow, _context: Any) -> None:
    if not _quiet:
        _changed(row.id_data, interactive=True)


def _changed(scene: bpy.types.Scene, interactive: bool = False) -> None:
    from . import handlers

    handlers.changed(scene, interactive=interactive)


class RelumeRow(bpy.types.PropertyGroup):
    """One line of the mix; kept in the .blend file."""

    kind: EnumProperty(
        name="Kind",
        description="What the row stands for",
        items=[
            (LIGHT, "Light", "A light object"),
            (GROUP, "Group", "A collection with lights in it"),
            (WORLD, "World", "Light of the world"),
            (STATIC, "Emissive Materials", "Light of emissive materials"),
        ],
        options={"HIDDEN"},
    )
    uid: IntProperty(name="Session UID", description="Finds the light again under another name", options={"HIDDEN"})
    groups: StringProperty(name="Groups", description="Collections with this light, by line", options={"HIDDEN"})
    present: BoolProperty(name="Present", description="Whether the scene has this light now", options={"HIDDEN"})
    hidden: BoolProperty(name="Hidden", description="Whether renders or views lack this light", options={"HIDDEN"})
    named: BoolProperty(
        name="Named", description="Whether geometry nodes or particles may show this light itself", options={"HIDDEN"}
    )
    depth: IntProperty(name="Depth", description="Collections around this row that have a line", options={"HIDDEN"})
    single: BoolProperty(name="Single", description="Whether a collection has one light alone", options={"HIDDEN"})
    order: IntProperty(name="Order", description="Place in the list", options={"HIDDEN"})
    icon: StringProperty(name="Icon", description="Icon of the row", options={"HIDDEN"})
    open: BoolProperty(name="Open", description="Show the rows of this collection", default=True)
    on: BoolProperty(
        name="On", description="Whether this light shines. Writes nothing to the scene", default=True, update=_edited
    )
    solo: BoolProperty(
        name="Solo",
        description="Only soloed rows are seen; several can be. A soloed group is all of its lights",
        update=_edited,
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Brightness in stops: one more is twice the light",
        soft_min=-10.0,
        soft_max=10.0,
        min=-32.0,
        max=32.0,
        step=10,
        precision=2,
        update=_edited,
    )
    multiplier: FloatProperty(
        name="Multiplier",
        description="Brightness as a factor, besides the exposure",
        default=1.0,
        min=0.0,
        soft_max=10.0,
        max=1e6,
        step=5,
        precision=2,
        update=_edited,
    )
    color: FloatVectorProperty(
        name="Colour",
        description="Tint, besides the light's own colour",
        subtype="COLOR",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=1.0,
        update=_edited,
    )
    use_kelvin: BoolProperty(
        name="Kelvin",
        description="Tint by a colour temperature too. 6500 K is nearly white",
        update=_edited,
    )
    kelvin: FloatProperty(
        name="Temperature",
        description="Colour temperature in kelvin: low is warm, high is cool",
        default=6500.0,
        min=800.0,
        max=20000.0,
        soft_min=1000.0,
        soft_max=12000.0,
        step=5000,
        precision=0,
        update=_edited,
    )

    locks: PointerProperty(type=RelumeLocks, name="Locks", description="What solving may change of this light")

    def values(self) -> core.Row:
        """The row as plain data."""
        return core.Row(
            name=self.name,
            kind=self.kind,
            on=self.on,
            solo=self.solo,
            exposure=self.exposure,
            multiplier=self.multiplier,
            color=tuple(self.color),
            use_kelvin=self.use_kelvin,
            kelvin=self.kelvin,
        )

    def take(self, values: core.Row) -> None:
        """Sets what an artist sets; asks for no picture."""
        with quiet():
            _write(self, {name: getattr(values, name) for name in VALUES})


class RelumeMix(bpy.types.PropertyGroup):
    """All rows of a scene; kept in the .blend file."""

    rows: CollectionProperty(type=RelumeRow, name="Rows", description="Lights, collections, world, emissive materials")
    active: IntProperty(name="Row", description="The row whose details are shown below")
    search: StringProperty(
        name="Search", description="Show the rows with these words in their name", options={"TEXTEDIT_UPDATE"}
    )
    grouped: BoolProperty(name="Collections", description="Show lights below their collections", default=True)
    session: StringProperty(name="Session", description="Run of Blender that wrote the uids", options={"HIDDEN"})


def present_rows(scene: bpy.types.Scene) -> list[RelumeRow]:
    """The rows of what the scene has now, in no order."""
    return [row for row in scene.relume_mix.rows if row.present]


def active_row(scene: bpy.types.Scene) -> RelumeRow | None:
    """The row whose details are shown."""
    state = scene.relume_mix
    row = state.rows[state.active] if 0 <= state.active < len(state.rows) else None
    return row if row and row.present else None


def mix(scene: bpy.types.Scene, lights: Iterable[str]) -> dict[str, Any]:
    """Gains from the rows for lights by their names in the native scene, for `Shot.relight`. Kept as long as no row
    changes, for example while one of many lights is dragged."""
    key = _contents(scene), tuple(lights)
    kept = _mixes.get(scene.session_uid)
    if kept is None or kept[0] != key:
        kept = _mixes[scene.session_uid] = key, core.mix_for(key[1], *plain(scene))
    return kept[1]


def _contents(scene: bpy.types.Scene) -> tuple:
    """All that `plain` reads, read at once, which is quicker than row by row."""
    rows = scene.relume_mix.rows
    numbers = []
    for name in ("present", *VALUES):
        numbers.append(np.empty(3 * len(rows) if name == "color" else len(rows), np.float32))
        rows.foreach_get(name, numbers[-1])
    return np.concatenate(numbers).tobytes(), [(row.name, row.kind, row.groups) for row in rows]


def plain(scene: bpy.types.Scene) -> tuple[list[core.Row], list[core.Row], dict[str, list[str]]]:
    """Rows, groups and memberships, as `core.rows.mix` takes them."""
    rows, groups, memberships = [], [], {}
    for row in present_rows(scene):
        (groups if row.kind == GROUP else rows).append(row.values())
        if row.kind == LIGHT:
            memberships[row.name] = row.groups.split("\n") if row.groups else []
    return rows, groups, memberships


def line_of(scene: bpy.types.Scene, name: str) -> Line | None:
    """The light of a row, and the collections that it is in."""
    return next((line for line in light_tree(scene) if line.kind == LIGHT and name_of(line.block) == name), None)


def reset(scene: bpy.types.Scene, rows: Iterable[RelumeRow] | None = None) -> None:
    """Makes rows neutral, all of them by default, and shows it."""
    for row in present_rows(scene) if rows is None else rows:
        row.take(core.Row(row.name))
    _changed(scene)


def sync(scene: bpy.types.Scene) -> None:
    """Makes the rows those of the scene's lights, collections and world. A linked scene cannot have its own."""
    if not scene.is_editable:
        return
    state = scene.relume_mix
    wanted = [_line_values(line) for line in light_tree(scene)]
    _lift_out_of_singles(wanted)
    rest = {"uid": 0, "depth": 0, "groups": "", "hidden": False, "named": False, "single": False}
    wanted.append({"kind": WORLD, "name": "World", "icon": "WORLD", "present": scene.world is not None, **rest})
    wanted.append({"kind": STATIC, "name": "Emissive Materials", "icon": "MATERIAL", "present": True, **rest})
    with quiet():
        places = _places(state, wanted)
        for order, (place, values) in enumerate(zip(places, wanted, strict=True)):
            _write(state.rows[place], values | {"order": order})
        gone = sorted(set(range(len(state.rows))) - set(places))
        if state.session != SESSION:  # Nothing can be undone that was done before the file was opened.
            for place in reversed(gone):
                state.rows.remove(place)
            state.session = SESSION
        else:
            for order, place in enumerate(gone, len(wanted)):
                _write(state.rows[place], {"present": False, "order": order})


def _line_values(line: Line) -> dict[str, Any]:
    block = line.block
    group = {"name": name_of(block), "icon": "OUTLINER_COLLECTION", "present": True, "hidden": False}
    return {
        "kind": line.kind,
        "uid": block.session_uid,
        "depth": line.depth,
        "groups": "\n".join(line.groups),
        "named": line.is_named,
        "single": False,
        **(_light_values(block) if line.kind == LIGHT else group),
    }


def _lift_out_of_singles(lines: list[dict[str, Any]]) -> None:
    """Marks collections with a single light, which need no line of their own, and takes their depth from its."""
    depths = [line["depth"] for line in lines]
    for number, (line, depth) in enumerate(zip(lines, depths, strict=True)):
        end = next((other for other in range(number + 1, len(lines)) if depths[other] <= depth), len(lines))
        inside = lines[number + 1 : end]
        line["single"] = line["kind"] == GROUP and sum(other["kind"] == LIGHT for other in inside) == 1
        for other in inside if line["single"] else ():
            other["depth"] -= 1


def _light_values(light: bpy.types.Object) -> dict[str, Any]:
    """Values of a light's row that can change when only the light is edited."""
    return {
        "name": name_of(light),
        "icon": LIGHT_ICONS[light.data.type],
        "present": is_light(light),
        "hidden": light.hide_render or light.hide_viewport,
    }


def _places(state: RelumeMix, wanted: list[dict[str, Any]]) -> list[int]:
    """Places of the rows of all lines; rows are added for new ones. Adding moves rows in memory, so places are kept
    here."""
    by_uid = state.session == SESSION
    known: dict[tuple, int] = {}
    for place, row in enumerate(state.rows):
        known.setdefault((row.kind, row.uid if by_uid else row.name), place)
    # Taken once. What is linked had its bare name before Relume told lights of libraries apart.
    places = [known.pop((values["kind"], values["uid"] if by_uid else values["name"]), None) for values in wanted]
    for number, values in enumerate(wanted):
        if places[number] is None and not by_uid:
            places[number] = known.pop((values["kind"], core.bare_name(values["name"])), None)
        if places[number] is None:
            places[number] = len(state.rows)
            state.rows.add()
    return places


def _write(row: bpy.types.PropertyGroup, values: dict[str, Any]) -> None:
    """Writes what differs, since every write is an update of the scene."""
    for name, value in values.items():
        before = getattr(row, name)
        if (tuple(before) if name == "color" else before) != value:
            setattr(row, name, value)


@persistent
def on_depsgraph_update(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
    """Lights may have come, gone or changed their names."""
    lights, kind, around = [], bpy.types.Object, (bpy.types.Collection, bpy.types.World)
    for update in depsgraph.updates:
        block = update.id
        if isinstance(block, kind):
            if block.type == "LIGHT" and not update.is_updated_transform:
                lights.append(block.original)
        elif isinstance(block, around):
            _sync_soon([scene])
            return
    if _differ(scene, lights):
        _sync_soon([scene])


def _sync_soon(scenes: Iterable[bpy.types.Scene]) -> None:
    """Compares the rows of scenes in a turn of the window of its own: lights are read in this one."""
    from . import handlers

    _due.update(scene.session_uid for scene in scenes)
    if bpy.app.background:
        sync_due()
    else:
        handlers.wake()


def are_due() -> bool:
    """True if rows are waiting to be compared with their scene."""
    return bool(_due)


def sync_due() -> bool:
    """Compares the rows that may be outdated with their scenes; returns True if there were any."""
    due = [scene for scene in bpy.data.scenes if scene.session_uid in _due]
    _due.clear()
    for scene in due:
        sync(scene)
    return bool(due)


def _differ(scene: bpy.types.Scene, lights: list[bpy.types.Object]) -> bool:
    """True if the row of one of the lights is outdated. Spares a walk over the whole scene in a drag, an edit of a
    light's values, or a move of a row's slider."""
    rows = {row.uid: row for row in scene.relume_mix.rows if row.kind == LIGHT} if lights else {}

    def is_same(light: bpy.types.Object) -> bool:
        row = rows.get(light.session_uid)
        return row is not None and all(getattr(row, name) == value for name, value in _light_values(light).items())

    return not all(is_same(light) for light in lights)


@persistent
def on_undo(*_arguments) -> None:
    """Lights may be back, or gone again."""
    _sync_soon(bpy.data.scenes)


@persistent
def on_load(*_arguments) -> None:
    """Finds the rows of a file that was opened, by name."""
    for scene in bpy.data.scenes:
        if scene.is_editable:
            scene.relume_mix.session = ""
        sync(scene)


HANDLERS = {
    "depsgraph_update_post": on_depsgraph_update,
    "undo_post": on_undo,
    "redo_post": on_undo,
    "load_post": on_load,
}
CLASSES = (RelumeRow, RelumeMix)


def register():
    """Adds `scene.relume_mix` and makes its rows follow the scene."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.relume_mix = PointerProperty(type=RelumeMix)
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).append(handler)
    if hasattr(bpy.data, "scenes"):  # Not while Blender itself starts; a file is opened then anyway.
        on_load()


def unregister():
    """Takes it away; values stay in the file."""
    for name, handler in HANDLERS.items():
        getattr(bpy.app.handlers, name).remove(handler)
    _due.clear()
    del bpy.types.Scene.relume_mix
    _mixes.clear()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
