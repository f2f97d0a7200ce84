"""Rows of the mix, `scene.relume_mix`, kept in step with the scene: a row for every light, every collection with
lights, the world and the light of emissive materials. Nothing here writes to a light.

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

from ..core import rows as core
from ..core.rows import GROUP, LIGHT, STATIC, WORLD
from ..core.shots import AUTOMATIC
from ..export.current_shot import current_entry, entries
from ..export.light_tree import Line, is_light, light_tree
from ..export.lights import name_of

VALUES = ("on", "solo", "exposure", "multiplier", "color", "use_kelvin", "kelvin")
"""Properties of a row that the artist sets; the names are those of `core.rows.Row`."""
SESSION = uuid.uuid4().hex
"""Session uids mean something only within one run of Blender."""
LIGHT_ICONS = {"POINT": "LIGHT_POINT", "SUN": "LIGHT_SUN", "SPOT": "LIGHT_SPOT", "AREA": "LIGHT_AREA"}


_silencers: list[None] = []
"""An entry for each context that writes rows silently."""
_outdated: set[int] = set()
"""Scenes whose rows are to be compared."""
_mixes: dict[tuple[int, str], tuple[tuple, dict[str, Any]]] = {}
"""Newest mix of each scene and key of a shot, with all that it follows from."""


@contextmanager
def silently() -> Iterator[None]:
    """Context in which rows are written without a request for a picture."""
    _silencers.append(None)
    try:
        yield
    finally:
        _silencers.pop()


def are_silent() -> bool:
    """True while rows are written `silently`."""
    return bool(_silencers)


def take(row: Any, values: core.Row) -> None:
    """Sets what an artist sets of a row, or of its values in one shot; asks for no picture."""
    with silently():
        _write(row, {name: getattr(values, name) for name in VALUES if hasattr(row, name)})


def own_values(row: Any, shot: str) -> Any | None:
    """The values that a row has in the shot of a key alone; None without."""
    return next((own for own in row.own if own.shot == shot), None)


def give_own_values(row: Any, shot: str, values: core.Row) -> None:
    """Gives a row values of its own in the shot of a key; asks for no picture."""
    own = own_values(row, shot)
    if own is None:
        own = row.own.add()
        own.shot = shot
    take(own, values)


def drop_own_values(row: Any, shot: str | None = None) -> None:
    """Takes a row's values of the shot of a key away, or those of all shots."""
    for place in reversed([place for place, own in enumerate(row.own) if shot in {None, own.shot}]):
        row.own.remove(place)


def drop_gone_shots(scene: bpy.types.Scene) -> None:
    """Takes values of shots away that are not in the list any more."""
    if not hasattr(scene, "relume_shots"):
        return
    keys = {entry.key for entry in entries(scene)}
    for row in scene.relume_mix.rows:
        for gone in {own.shot for own in row.own} - keys:
            drop_own_values(row, gone)


def current_key(scene: bpy.types.Scene) -> str:
    """Key of the current shot, whose values the rows show and set."""
    entry = current_entry(scene)
    return AUTOMATIC if entry is None else entry.key


def shots_with_own_values(scene: bpy.types.Scene, rows: Iterable[Any]) -> list[Any]:
    """Entries of the shots in which some of the rows have values of their own."""
    keys = {own.shot for row in rows for own in row.own}
    return [entry for entry in entries(scene) if entry.key in keys]


def present_rows(scene: bpy.types.Scene) -> list[Any]:
    """The rows of what the scene has now, in no order."""
    return [row for row in scene.relume_mix.rows if row.present]


def active_row(scene: bpy.types.Scene) -> Any | None:
    """The row whose details are shown."""
    state = scene.relume_mix
    row = state.rows[state.active] if 0 <= state.active < len(state.rows) else None
    return row if row and row.present else None


def mix(scene: bpy.types.Scene, lights: Iterable[str], shot: str = AUTOMATIC) -> dict[str, Any]:
    """Gains from the rows for lights by their names in the native scene, for `Shot.relight`, in the shot of a key. Kept
    as long as no row changes, for example while one of many lights is dragged."""
    key, place = (_contents(scene, shot), tuple(lights)), (scene.session_uid, shot)
    kept = _mixes.get(place)
    if kept is None or kept[0] != key:
        kept = _mixes[place] = key, core.mix_for(key[1], *plain(scene, shot))
    return kept[1]


def _contents(scene: bpy.types.Scene, shot: str) -> tuple:
    """All that `plain` reads, read at once, which is quicker than row by row."""
    rows = scene.relume_mix.rows
    numbers = []
    for name in ("present", *VALUES):
        numbers.append(np.empty(3 * len(rows) if name == "color" else len(rows), np.float32))
        rows.foreach_get(name, numbers[-1])
    names = [(row.name, row.kind, row.groups) for row in rows]
    own = [(place, own.dials()) for place, row in enumerate(rows) for own in row.own if own.shot == shot]
    return np.concatenate(numbers).tobytes(), names, own


def plain(scene: bpy.types.Scene, shot: str = AUTOMATIC) -> tuple[list[core.Row], list[core.Row], dict[str, list[str]]]:
    """Rows, groups and memberships, as `core.rows.mix` takes them, in the shot of a key."""
    rows: list[core.Row] = []
    groups: list[core.Row] = []
    memberships: dict[str, list[str]] = {}
    for row in present_rows(scene):
        (groups if row.kind == GROUP else rows).append(row.values(shot))
        if row.kind == LIGHT:
            memberships[row.name] = row.groups.split("\n") if row.groups else []
    return rows, groups, memberships


def line_of(scene: bpy.types.Scene, name: str) -> Line | None:
    """The light of a row, and the collections that it is in."""
    return next((line for line in light_tree(scene) if line.kind == LIGHT and name_of(line.block) == name), None)


def sync(scene: bpy.types.Scene) -> None:
    """Makes the rows those of the scene's lights, collections and world. A linked scene cannot have its own."""
    if not scene.is_editable:
        return
    state = scene.relume_mix
    drop_gone_shots(scene)
    wanted = [_line_values(line) for line in light_tree(scene)]
    _lift_out_of_singles(wanted)
    rest = {"uid": 0, "depth": 0, "groups": "", "hidden": False, "named": False, "single": False}
    wanted.append({"kind": WORLD, "name": "World", "icon": "WORLD", "present": scene.world is not None, **rest})
    wanted.append({"kind": STATIC, "name": "Emissive Materials", "icon": "MATERIAL", "present": True, **rest})
    with silently():
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


def _places(state: Any, wanted: list[dict[str, Any]]) -> list[int]:
    """Places of the rows of all lines; rows are added for new ones. Adding moves rows in memory, so places are kept
    here."""
    by_uid = state.session == SESSION
    known: dict[tuple, int] = {}
    for number, row in enumerate(state.rows):
        known.setdefault((row.kind, row.uid if by_uid else row.name), number)
    # Taken once. What is linked had its bare name before Relume told lights of libraries apart.
    found = [known.pop((values["kind"], values["uid"] if by_uid else values["name"]), None) for values in wanted]
    places: list[int] = []
    for values, place in zip(wanted, found, strict=True):
        if place is None and not by_uid:
            place = known.pop((values["kind"], core.bare_name(values["name"])), None)
        if place is None:
            place = len(state.rows)
            state.rows.add()
        places.append(place)
    return places


def _write(row: bpy.types.PropertyGroup, values: dict[str, Any]) -> None:
    """Writes what differs, since every write is an update of the scene."""
    for name, value in values.items():
        before = getattr(row, name)
        if (tuple(before) if name == "color" else before) != value:
            setattr(row, name, value)


def are_outdated(scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> bool:
    """True if lights may have come, gone or changed their names."""
    lights, kind, around = [], bpy.types.Object, (bpy.types.Collection, bpy.types.World)
    for update in depsgraph.updates:
        block = update.id
        if isinstance(block, kind):
            if block.type == "LIGHT" and not update.is_updated_transform:
                lights.append(block.original)
        elif isinstance(block, around):
            return True
    return _differ(scene, lights)


def mark_outdated(scenes: Iterable[bpy.types.Scene]) -> None:
    """Has the rows of scenes compared by the next `sync_due`."""
    _outdated.update(scene.session_uid for scene in scenes)


def are_due() -> bool:
    """True if rows are waiting to be compared with their scene."""
    return bool(_outdated)


def sync_due() -> bool:
    """Compares the rows that may be outdated with their scenes; returns True if there were any."""
    due = [scene for scene in bpy.data.scenes if scene.session_uid in _outdated]
    _outdated.clear()
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


def find_by_name() -> None:
    """Finds the rows of a file that was opened, by name."""
    for scene in bpy.data.scenes:
        if scene.is_editable:
            scene.relume_mix.session = ""
        sync(scene)


def forget() -> None:
    """Forgets what was noticed of any scene."""
    _outdated.clear()
    _mixes.clear()
