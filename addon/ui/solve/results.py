"""Looks that a solve leaves: how it was, and how it could be; and applying them to the lights."""

from __future__ import annotations

import json
from collections.abc import Generator
from functools import partial
from typing import Any

import bpy

from ...apply.look_lights import light_state
from ...core import solve as core
from ...core.background_call import run_in_thread
from ...core.looks import Look
from ...core.receivers import with_names
from ...core.rows import WORLD, is_neutral
from ...core.words import grouped
from ...engine.shot import requests
from ...engine.shot import shot as shots
from ...engine.solve.solving import Result, Solving
from ...export.light_tree import light_objects
from ...export.lights import name_of
from ...live import rows
from ...live.scheduler import scheduler
from ...viewport import compare as pairs
from ...viewport import view_table
from .. import looks, thumbnails

SOLVED, BEFORE = "Solve", "Before"
WORLD_STAYS = (
    "The world's light is in its row, which renders by Cycles do not have: Apply to Lights writes it into the world"
)


def keep(before: Look, solving: Solving, result: Result) -> Generator[None, None, str]:
    """Keeps two looks: `before` the solve, and the result. Returns the UID of the latter; empty if the scene is
    gone."""
    small = yield from _thumbnails(solving.scene(), (result.before_frame, result.frame))
    scene = solving.scene()
    return "" if scene is None else _finish(scene, before, solving, result, small)


def _thumbnails(scene: bpy.types.Scene | None, frames: tuple[Any, Any]) -> Generator[None, None, list[str]]:
    """Thumbnails of frames; empty where there is no picture."""
    small = []
    view = scene and view_table.of(scene)
    for frame in frames:
        if frame is None or scene is None:
            small.append("")
        elif view is None:
            small.append(thumbnails.encode(scene, frame.image))
        else:
            small.append((yield from run_in_thread(partial(thumbnails.encode_in, view, frame.image))))
    return small


def _finish(scene: bpy.types.Scene, before: Look, solving: Solving, result: Result, small: list[str]) -> str:
    """Keeps both looks and the report, and compares the pictures; `small` has the thumbnails."""
    answer, shot = result.answer, solving.shot
    present = {name_of(obj): light_state(obj) for obj in light_objects(scene)}
    names = {obj.name for obj in bpy.data.objects}
    solved = core.solved(answer, present, result.content["lights"], result.asked["lights"], names)
    solving.notes += [f"Light '{name}' is gone: what was solved for it is left out" for name in solved.gone]
    solving.notes += answer["warnings"]
    before_request = _named(shot, requests.request_text(result.content))
    before_name = _keep_before(scene, before, before_request, small[0])
    shown = [state["name"] for state in solved.states if not state["hidden"]]
    solved_rows = core.solved_rows(rows.plain(scene), shown, _world_gain(shot, result))
    look = Look(f"{SOLVED} {_next_number(scene)}", tuple(solved_rows), tuple(solved.states))
    entry = _add(scene, look, _named(shot, result.picture_request), small[1])
    entry.solved = True
    scene.relume_solve.report = json.dumps(
        {
            "look": entry.name,
            "lines": [{"text": _line(solving, result, line), "met": line["met"]} for line in answer["report"]],
            "notes": grouped(tuple(solving.notes)),
        }
    )
    if result.frame is not None:
        labels = (entry.name, before_name)
        pairs.set_pair(scene, result.frame, result.before_frame, scene.relume_view.compare, labels)
    scheduler.request_picture(scene)
    return entry.uid


def _line(solving: Solving, result: Result, line: dict[str, Any]) -> str:
    """Line of the report on a goal, with the name of its shot if that is another one than the current."""
    if all(not view.name for view in solving.views):
        return line["text"]
    name = solving.views[result.asked["goals"][line["number"]].get("view", 0)].name
    return f"'{name}': {line['text']}" if name else line["text"]


def _world_gain(shot: shots.Shot, result: Result) -> list[float] | None:
    """Gain of the world's row, which is relative to the world as it was edited since the bake; None if unchanged."""
    world = result.answer["world"]
    if world == result.asked["world"]:
        return None
    edited = shot.changes.world_gain()
    return [gain / max(factor, 1e-6) for gain, factor in zip(world, edited, strict=True)]


def _keep_before(scene: bpy.types.Scene, look: Look, request: str, thumbnail: str) -> str:
    """Name of the look before solving: a new one, unless there is one already."""
    for entry in scene.relume_looks.items:
        if entry.name.startswith(BEFORE) and entry.request == request:
            return entry.name
    return _add(scene, look, request, thumbnail).name


def _add(scene: bpy.types.Scene, look: Look, request: str, thumbnail: str) -> looks.RelumeLook:
    entry = looks.add(scene, look)
    entry.request, entry.thumbnail = request, thumbnail
    return entry


def _named(shot: shots.Shot, request: str) -> str:
    """A request as looks keep it."""
    return with_names(request, shot.lights.receivers)


def _next_number(scene: bpy.types.Scene) -> int:
    names = {look.name for look in scene.relume_looks.items}
    return next(number for number in range(1, len(names) + 2) if f"{SOLVED} {number}" not in names)


def apply(scene: bpy.types.Scene, look: looks.RelumeLook) -> list[str]:
    """Writes a solved look into the scene's lights, makes the new ones, and clears strokes and places. Returns
    sentences for the artist. Raises LookError or RefusedError, and has then written nothing."""
    outcome = looks.restore(scene, look.look(), lights=True)
    pairs.clear(scene)
    settings = scene.relume_solve
    # Goals are relative to the picture before: once more would be twice as much.
    settings.strokes = ""
    settings.regions.clear()
    # A look has the world as a factor. In the world itself it would be there twice once the look is restored.
    world = [WORLD_STAYS for row in rows.present_rows(scene) if row.kind == WORLD and not is_neutral(row.values())]
    if settings.report:
        report = json.loads(settings.report)
        notes = list(dict.fromkeys([*report["notes"], *world]))
        settings.report = json.dumps(report | {"applied": report["look"] == look.name, "notes": notes})
    return [words for words in (str(outcome), *world) if words]
