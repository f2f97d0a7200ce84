"""The looks of a scene, `scene.relume_looks`: made from the rows and lights as they are, put back, and passed on as
JSON. Restoring writes to the rows; only with the lights' own values, which it asks for, to the lights."""

from __future__ import annotations

import uuid
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, IntProperty, PointerProperty, StringProperty

from ..apply import new_lights
from ..apply.look_lights import light_state, refusals, restore_lights
from ..apply.writable import RefusedError
from ..core.looks import Look, LookError, from_json, match, own_rows, to_json
from ..core.receivers import with_names
from ..engine.reading import usd_files
from ..engine.shot import requests
from ..engine.shot import shot as shots
from ..export.current_shot import entries
from ..export.light_tree import light_objects
from ..export.lights import name_of
from ..live import rows
from ..live.scheduler import scheduler
from . import thumbnails


def _renamed(entry: RelumeLook, _context: Any) -> None:
    """Two looks of one name could not be told apart."""
    others = {look.name for look in entry.id_data.relume_looks.items if look.uid != entry.uid}
    if entry.name in others:
        entry.name = free_name(entry.name, others)


class RelumeLook(bpy.types.PropertyGroup):
    """One look; kept in the .blend file."""

    name: StringProperty(name="Name", description="Name of the look", update=_renamed)
    uid: StringProperty(name="UID", description="Tells looks apart", options={"HIDDEN"})
    text: StringProperty(name="Values", description="The look in the form of its files", options={"HIDDEN"})
    request: StringProperty(name="Request", description="What its picture was asked with, by names", options={"HIDDEN"})
    solved: BoolProperty(name="Solved", description="Made by solving: it is about lights, not rows", options={"HIDDEN"})
    thumbnail: StringProperty(name="Thumbnail", description="Its picture, small", options={"HIDDEN"})

    def look(self) -> Look:
        """Look as plain data."""
        return replace(from_json(self.text), name=self.name)


class RelumeLooks(bpy.types.PropertyGroup):
    """All looks of a scene; kept in the .blend file."""

    items: CollectionProperty(type=RelumeLook, name="Looks", description="Saved states of rows and lights")
    active: IntProperty(name="Look", description="The look that the buttons are about")
    other: StringProperty(name="With", description="The look to compare with; empty: the present picture")


@dataclass(frozen=True)
class Outcome:
    """Parts of a look that had no counterpart in the scene."""

    missing: list[str]
    """Lights, groups and shots of the look that the scene does not have."""
    unknown: list[str]
    """Lights of the scene that the look does not know; they are switched off."""

    def __str__(self) -> str:
        sentences = []
        if self.missing:
            sentences.append(f"not in this scene: {', '.join(self.missing)}")
        if self.unknown:
            sentences.append(f"not in the look, so switched off: {', '.join(self.unknown)}")
        return "; ".join(sentences)


def snapshot(scene: bpy.types.Scene, name: str = "Look") -> RelumeLook:
    """Keeps rows, lights and, if it is there already, their picture."""
    entry = add(scene, current(scene, name))
    shot = shots.of(scene)
    if shot is not None:
        request = requests.request_text(scheduler.content_of(scene, shot))
        entry.request = with_names(request, shot.lights.receivers)
        if shot.present_frame is not None:
            entry.thumbnail = thumbnails.encode(scene, shot.present_frame.image)
    return entry


def current(scene: bpy.types.Scene, name: str) -> Look:
    """Rows and lights as they are."""
    rows.sync(scene)
    present = rows.present_rows(scene)
    own = {
        entry.name: tuple(row.values(entry.key) for row in present if rows.own_values(row, entry.key) is not None)
        for entry in rows.shots_with_own_values(scene, present)
    }
    lights = tuple(map(light_state, light_objects(scene)))
    return Look(name, tuple(row.values() for row in present), lights, own)


def add(scene: bpy.types.Scene, look: Look) -> RelumeLook:
    """Keeps a look, under a name that is not taken."""
    state = scene.relume_looks
    name = free_name(look.name, {entry.name for entry in state.items})
    entry = state.items.add()
    entry.uid, entry.text = uuid.uuid4().hex, to_json(look)
    entry.name = name
    state.active = len(state.items) - 1
    return entry


def free_name(name: str, others: set[str]) -> str:
    """The name, numbered as Blender does if it is taken."""
    name = name or "Look"
    numbers = (f"{name}.{number:03}" for number in range(1, len(others) + 2))
    return name if name not in others else next(numbered for numbered in numbers if numbered not in others)


def restore(scene: bpy.types.Scene, look: Look, lights: bool = False) -> Outcome:
    """Puts the rows back, also their values in single shots, and with `lights` the lights as they were too. Raises
    LookError or RefusedError, and has then written nothing."""
    rows.sync(scene)
    if not (lights and any(state.get("added") for state in look.lights)):
        match(look, [row.values() for row in rows.present_rows(scene)])
    if lights:
        _restore_lights(scene, look)
    present = rows.present_rows(scene)
    matched = match(look, [row.values() for row in present])
    for row, values in zip(present, matched.rows, strict=True):
        rows.drop_own_values(row)
        row.take(values)
    for entry in entries(scene):
        for row, own in zip(present, own_rows(look, entry.name, matched.rows), strict=True):
            if own is not None:
                rows.give_own_values(row, entry.key, own)
    scheduler.read_lights(scene)
    return Outcome(matched.missing + _missing_shots(scene, look), matched.unknown)


def _missing_shots(scene: bpy.types.Scene, look: Look) -> list[str]:
    there = {entry.name for entry in entries(scene)}
    return [f"shot '{name}'" for name in look.shots if name not in there]


def _restore_lights(scene: bpy.types.Scene, look: Look) -> None:
    """Makes the lights that the look adds and are not there, then writes all; or raises, and has done nothing."""
    lights = light_objects(scene)
    names = {name_of(obj) for obj in lights}
    added = [state for state in look.lights if state.get("added") and state["name"] not in names]
    reasons = [*refusals(lights, look.lights), *new_lights.refusals(scene, added)]
    if reasons:
        raise RefusedError(reasons)
    restore_lights([*lights, *new_lights.make(scene, added)], look.lights)
    rows.sync(scene)


def delete(scene: bpy.types.Scene, place: int) -> None:
    """Forgets a look."""
    state = scene.relume_looks
    state.items.remove(place)
    state.active = max(0, min(state.active, len(state.items) - 1))


def export_file(look: Look, path: Path) -> None:
    """Writes a look, whole or not at all. Raises OSError."""
    partial_file = path.with_name(f".part-{path.name}")
    try:
        partial_file.write_text(to_json(look), encoding="utf-8")
        partial_file.replace(path)
    finally:
        partial_file.unlink(missing_ok=True)


def import_file(scene: bpy.types.Scene, path: Path) -> tuple[RelumeLook, Outcome]:
    """Adds a look from a file; the outcome names its parts that this scene lacks. Raises LookError or OSError."""
    if path.stat().st_size > 1 << 26:
        raise LookError(f"this is not a look: {path.name} is larger than 64 MB")
    look = from_json(path.read_bytes())
    rows.sync(scene)
    matched = match(look, [row.values() for row in rows.present_rows(scene)])
    return add(scene, look), Outcome(matched.missing + _missing_shots(scene, look), matched.unknown)


def import_lights(scene: bpy.types.Scene, path: Path) -> tuple[RelumeLook, list[str]]:
    """Adds a look from a file of OpenUSD; also says what the file has and the look has not. Raises UsdError or
    OSError."""
    look, warnings = usd_files.read_file(path)
    rows.sync(scene)
    return add(scene, look), warnings


def active_look(scene: bpy.types.Scene) -> RelumeLook | None:
    """The look that the buttons are about."""
    state = scene.relume_looks
    return state.items[state.active] if 0 <= state.active < len(state.items) else None


CLASSES = (RelumeLook, RelumeLooks)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds `scene.relume_looks`."""
    _register()
    bpy.types.Scene.relume_looks = PointerProperty(type=RelumeLooks)


def unregister():
    """Takes it away; values stay in the file."""
    thumbnails.free()
    del bpy.types.Scene.relume_looks
    _unregister()
