"""Solving in the background of Blender's window: a step at a time, with previews, until a new look is there.

Nothing here writes to lights. What was solved is a look, and `relume.apply_solved` writes it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Generator, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..apply.look_lights import light_state
from ..core import coverage
from ..core import solve as core
from ..core.background_call import run_in_thread
from ..core.looks import Look
from ..core.progress import share_and_words
from ..core.receivers import with_names
from ..core.rows import LIGHT, WORLD, Row, freed, is_neutral, times
from ..core.solve import SolveError
from ..core.status import STAGES
from ..core.strokes import Stroke, goals
from ..core.words import grouped, listed
from ..engine.shot import shot
from ..engine.solve import handle as solve
from ..engine.solve import new_paths, region_masks
from ..engine.workers.pictures import Reading
from ..export.lights import name_of
from ..export.target import resized
from ..viewport import compare as pairs
from ..viewport import view_table
from . import compare, handlers, limits, locks, looks, regions, rows, target, thumbnails
from .solve_settings import EFFORTS, WHOLE, strokes_of

PREVIEW_SECONDS = 0.4
"""Between previews: the picture needs the processor as well."""
PICTURE_SECONDS = 60.0
"""How long the picture of the result is waited for; without it the look has no thumbnail."""
STEP_SECONDS = 0.03
"""Between steps where nobody sees them."""
COARSE = (160, 90)
"""Size at which strokes are looked at for whether anything is left of them."""
SOLVED, BEFORE = "Solve", "Before"
UNCERTAIN, REBAKE = "so the result is uncertain", "Rebake, then solve again"
WORLD_STAYS = (
    "The world's light is in its row, which renders by Cycles do not have: Apply to Lights writes it into the world"
)

_running: dict[int, Solving] = {}


class Solving:
    """The lights of one scene being solved."""

    def __init__(self, scene: bpy.types.Scene):
        found = shot.of(scene)
        if found is None:
            raise SolveError("Press Start first: lights are solved in the paths of a bake")
        if not found.status["samples"]:
            raise SolveError("Wait for the first picture")
        if found.is_changing_world or not found.status["world_is_stored"]:
            raise SolveError("The world has changed: wait until its light is gathered from all paths")
        self.shot, self.uid = found, scene.session_uid
        self.progress: tuple[float, str] = (0.0, "Looking at the goals")
        self.entry = ""
        """UID of the look that came of it."""
        content = handlers.content_of(scene, found)
        free, self.notes = locks.free(scene, [light["name"] for light in content["lights"]])
        for name, gain in content["gains"].items():
            if not any(gain):  # What is switched off stays off.
                free.pop(name, None)
        self._images: dict[str, np.ndarray] = {}
        self._seen: dict[str, region_masks.Seen] = {}
        self._readings: dict[str, Reading] = {}
        self._size = target.picture_size(scene)
        self._strokes = strokes_of(scene)
        self._content = content
        self._wish = self._wish_of(scene, free)
        self._request: dict[str, Any] = {}
        self._before = looks.current(scene, BEFORE)
        self._before_request = shot.request_text(content)
        frame = found.present_frame
        self._before_frame = frame if frame is not None and compare.is_final(frame) else None
        self._job: Any = None
        self._work = self._run()

    def _wish_of(self, scene: bpy.types.Scene, free: dict[str, list[str]]) -> core.Wish:
        """All that is asked for but the strokes."""
        settings = scene.relume_solve
        starts, steps = EFFORTS[settings.effort]
        return core.Wish(
            free,
            [*self._region_goals(scene), *self._target_goals(scene)],
            keep_rest=settings.keep_rest,
            limits=limits.of(settings, settings.stay),
            own=limits.of_each(scene, free),
            add_count=settings.add_count,
            add_type=settings.add_type,
            remove=settings.remove,
            starts=starts,
            steps=steps,
        )

    def _region_goals(self, scene: bpy.types.Scene) -> list[dict[str, Any]]:
        found = []
        for number, region in enumerate(scene.relume_solve.regions, 1):
            name = f"mask {number}"
            place = self._with_mask(scene, name, regions.where(region, name))
            found.append(region.meaning().plain() | {"where": place})
        return found

    def _target_goals(self, scene: bpy.types.Scene) -> list[dict[str, Any]]:
        settings = scene.relume_solve
        if settings.target is None:
            return []
        invariant, weight = settings.target_exposure, settings.target_weight
        goal = {"goal": "target", "image": "target", "exposure_invariant": invariant, "weight": weight}
        if settings.target_place.kind == WHOLE:
            return [goal]
        name, instead = "mask of the target", "let it count in the whole picture"
        found = regions.where(settings.target_place, name, "The target's place", instead)
        return [goal | {"where": self._with_mask(scene, name, found)}]

    def _with_mask(self, scene: bpy.types.Scene, name: str, found: tuple[dict[str, Any], Any]) -> dict[str, Any]:
        """A place, whose mask is still to be read or looked for."""
        place, mask = found
        if isinstance(mask, region_masks.Seen):
            self._seen[name] = mask
        elif mask is not None:
            self._readings[name] = Reading(scene, mask, self._size, None)
        return place

    @property
    def is_running(self) -> bool:
        """True until it has ended, whatever scene is shown."""
        return _running.get(self.uid) is self

    def step(self) -> bool:
        """Goes on for a moment; whether there is more to do. Has ended if it raises, for the artist SolveError."""
        try:
            if not self.shot.is_open:
                raise SolveError("The bake was closed while lights were being solved")
            next(self._work)
            return True
        except StopIteration:
            _running.pop(self.uid, None)
            return False
        except Exception:
            self.cancel()
            raise

    def cancel(self) -> None:
        """Ends it and shows the lights as they are."""
        _running.pop(self.uid, None)
        if self._job is not None:
            self._job.cancel()
        self._work.close()
        for reading in self._readings.values():
            reading.close()
        scene = self._scene()
        if scene is not None:
            handlers.changed(scene)

    def _scene(self) -> bpy.types.Scene | None:
        """The scene, which undo may have replaced and another file removed."""
        return next((scene for scene in bpy.data.scenes if scene.session_uid == self.uid), None)

    def _run(self) -> Generator[None, None, None]:
        strokes = yield from run_in_thread(lambda: _stroke_goals(self._strokes))
        self._request = core.request(self._content, replace(self._wish, goals=[*strokes, *self._wish.goals]))
        yield from self._read_pictures()
        yield from self._look_for_masks()
        self._job = solve.start(self.shot, self._request, self._images)
        yield from self._wait_for_job()
        answer = solve.answer(self._job)
        if core.moved_out_of_sight(answer, self._request["lights"]):
            answer = yield from self._solve_on(answer)
        elif answer["rarely_met"]:
            self.notes.append(f"Few paths meet {listed(answer['rarely_met'])}, {UNCERTAIN}: {REBAKE}")
        self.progress = (1.0, "Making the picture")
        request = core.picture_request(answer, self._content["static"])
        frame = yield from self._picture(json.dumps(request | {"interactive": False}))
        small = yield from self._thumbnails(frame)
        scene = self._scene()
        if scene is not None:
            self._finish(scene, answer, request, frame, small)

    def _solve_on(self, answer: dict[str, Any]) -> Generator[None, None, dict[str, Any]]:
        """The answer, polished with paths that look for its lights; as it is where there can be none."""
        names = listed(answer["rarely_met"])
        try:
            found = yield from self._polished(answer)
        except (SolveError, OSError) as error:
            self.notes.append(f"Few paths meet {names}, {UNCERTAIN}: {error}")
            return answer
        self.notes.append(f"Few paths of the bake meet {names}; Rebake traces paths that look there")
        return found

    def _polished(self, answer: dict[str, Any]) -> Generator[None, None, dict[str, Any]]:
        scene = self._scene()
        if scene is None:
            return answer
        self.progress = (0.0, "Looking for the lights")
        with new_paths.folder_in(self.shot) as folder:
            work = new_paths.bake(scene, self.shot, answer["lights"]["lights"], folder)
            is_there = yield from self._wait_for_paths(work)
            if not is_there:
                raise SolveError(REBAKE)
            request = self._request | {"from": answer, "steps": 0, "starts": 1}
            self._job = solve.start(self.shot, request, self._images, folder)
            try:
                yield from self._wait_for_job()
            except GeneratorExit:  # It reads from the folder.
                new_paths.cancel(self._job, folder)
                raise
            return solve.answer(self._job)

    def _wait_for_paths(self, work: Generator[Any, None, bool]) -> Generator[None, None, bool]:
        try:
            while True:
                job = next(work)
                if job is not None:
                    self._tell(job, "Looking for the lights")
                yield
        except StopIteration as end:
            return end.value
        finally:
            work.close()

    def _read_pictures(self) -> Iterator[None]:
        """Masks and the target."""
        scene = self._scene()
        if scene is not None and scene.relume_solve.target is not None:
            self.progress = (0.0, "Reading the target")
            found = yield from target.awaited(scene)
            self._images["target"] = found.pixels
            self.notes += [found.words] * found.is_doubtful
        for name, reading in self._readings.items():
            self.progress = (0.0, "Reading masks")
            while reading.step():
                yield
            if reading.found is None:
                raise SolveError(reading.error)
            self._images[name] = reading.found.pixels

    def _thumbnails(self, frame: Any) -> Generator[None, None, list[str]]:
        """Thumbnails before and after solving; empty where there is no picture."""
        scene, small = self._scene(), []
        view = scene and view_table.of(scene)
        for picture in (self._before_frame, frame):
            if picture is None or scene is None:
                small.append("")
            elif view is None:
                small.append(thumbnails.encode(scene, picture.image))
            else:
                small.append((yield from run_in_thread(partial(thumbnails.encode_in, view, picture.image))))
        return small

    def _look_for_masks(self) -> Iterator[None]:
        if not self._seen:
            return
        self.progress = (0.0, "Looking for objects")
        masks: dict = {}
        width, height = self._size
        for found in region_masks.masks(self.uid, list(self._seen.values()), width / height):
            masks = found or {}
            yield
        for name, seen in self._seen.items():
            hidden = self._not_shown(seen)
            if seen not in masks or not masks[seen].any():
                raise SolveError(f"Not seen in the picture: {seen}{f', {hidden}' if hidden else ''}")
            if hidden:
                self.notes.append(f"Only a part of {seen} is looked at, {hidden}")
            mask = resized(masks[seen], self._size)
            self._images[name] = np.ascontiguousarray(mask, np.float32)

    def _not_shown(self, seen: region_masks.Seen) -> str:
        """Reason why the window hides something from a mask; empty if it does not."""
        scene = self._scene()
        names = region_masks.not_shown(scene, seen) if scene is not None else []
        return f"since {', '.join(map(repr, names))} is hidden in the view; show it and solve again" if names else ""

    def _wait_for_job(self) -> Iterator[None]:
        next_preview = 0.0
        while not self._job.done:
            self._tell(self._job)
            if time.monotonic() >= next_preview:
                found = self._job.preview()
                if found is not None:
                    self._preview(found)
                    next_preview = time.monotonic() + PREVIEW_SECONDS
            yield

    def _tell(self, job: Any, words: str = "") -> None:
        """How far a job is, with what its present stage does if there are no other words."""
        report = job.progress()
        if report is not None:
            share, so_far = share_and_words(report)
            self.progress = (share, f"{words or STAGES.get(report['stage'], 'Solving')}, {so_far}")

    def _preview(self, found: dict[str, Any]) -> None:
        """Shows the best lights and world so far."""
        request = core.picture_request(found, self._content["static"])
        self.shot.ask(json.dumps(request | {"interactive": True}))
        handlers.wake()

    def _picture(self, request: str) -> Iterator[None]:
        """Waits for the picture of the result and returns it; None where it does not come."""
        number, end = self.shot.ask(request), time.monotonic() + PICTURE_SECONDS
        handlers.wake()
        while time.monotonic() < end and self.shot.is_open and self.shot.can_show:
            frame = self.shot.frame
            if frame is not None and frame.request == number and compare.is_final(frame):
                return frame
            if frame is not None and frame.request > number:  # Something was edited meanwhile.
                number = self.shot.ask(request)
                handlers.wake()
            yield
        return None

    def _finish(self, scene: bpy.types.Scene, answer: dict, request: dict, frame: Any, small: list[str]) -> None:
        """Keeps how it was and how it could be as looks; `small` has their thumbnails."""
        present = {name_of(obj): light_state(obj) for obj in looks.lights_of(scene)}
        names = {obj.name for obj in bpy.data.objects}
        found = core.solved(answer, present, self._content["lights"], self._request["lights"], names)
        self.notes += [f"Light '{name}' is gone: what was solved for it is left out" for name in found.gone]
        self.notes += answer["warnings"]
        before = self._keep_before(scene, small[0])
        solved_rows = self._rows(scene, answer, [state for state in found.states if not state["hidden"]])
        look = Look(f"{SOLVED} {_next_number(scene)}", tuple(solved_rows), tuple(found.states))
        entry = _keep(scene, look, self._named(json.dumps(request | {"interactive": False})), small[1])
        entry.solved, self.entry = True, entry.uid
        scene.relume_solve.report = json.dumps(
            {
                "look": entry.name,
                "lines": [{"text": line["text"], "met": line["met"]} for line in answer["report"]],
                "notes": grouped(tuple(self.notes)),
            }
        )
        if frame is not None:
            pairs.set_pair(scene, frame, self._before_frame, scene.relume_view.compare, (entry.name, before))
        handlers.changed(scene)

    def _keep_before(self, scene: bpy.types.Scene, thumbnail: str) -> str:
        """The name of the look of how it was: a new one, unless there is one already."""
        request = self._named(self._before_request)
        for entry in scene.relume_looks.items:
            if entry.name.startswith(BEFORE) and entry.request == request:
                return entry.name
        return _keep(scene, self._before, request, thumbnail).name

    def _named(self, request: str) -> str:
        """A request as looks keep it."""
        return with_names(request, self.shot.lights.receivers)

    def _rows(self, scene: bpy.types.Scene, answer: dict, states: list[dict]) -> list[Row]:
        """Rows of the look: the answer's lights hold their gains themselves, the others keep them."""
        present, groups, memberships = rows.plain(scene)
        names = {state["name"] for state in states}
        found = freed(present, groups, memberships, names)
        known = {row.name for row in found if row.kind == LIGHT}
        found += [Row(name) for name in names - known]
        if answer["world"] == self._request["world"]:
            return found
        edited = self.shot.changes.world_gain()
        gain = [now / max(factor, 1e-6) for now, factor in zip(answer["world"], edited, strict=True)]
        return [times(Row(row.name, WORLD), gain) if row.kind == WORLD else row for row in found]


def _keep(scene: bpy.types.Scene, look: Look, request: str, thumbnail: str) -> looks.RelumeLook:
    entry = looks.add(scene, look)
    entry.request, entry.thumbnail = request, thumbnail
    return entry


def _next_number(scene: bpy.types.Scene) -> int:
    names = {look.name for look in scene.relume_looks.items}
    return next(number for number in range(1, len(names) + 2) if f"{SOLVED} {number}" not in names)


def _stroke_goals(strokes: tuple[Stroke, ...]) -> list[dict[str, Any]]:
    """The goals of strokes, without what was erased altogether."""
    covered = coverage.layers(strokes, COARSE).values()
    return [goal for goal, layer in zip(goals(strokes), covered, strict=True) if layer.any()]


def begin(scene: bpy.types.Scene) -> Solving:
    """Begins to solve; to be stepped until it ends. Raises SolveError with one line for the artist."""
    if running(scene) is not None:
        raise SolveError("Lights are being solved already")
    solving = _running[scene.session_uid] = Solving(scene)
    return solving


def solve_at_once(scene: bpy.types.Scene) -> None:
    """Solves to the end, for scripts without a window. Raises SolveError."""
    found = begin(scene)
    while found.step():
        found.shot.poll()
        time.sleep(STEP_SECONDS)


def running(scene: bpy.types.Scene) -> Solving | None:
    """Job that solves a scene; None if there is none."""
    return _running.get(scene.session_uid)


def apply(scene: bpy.types.Scene, look: looks.RelumeLook) -> list[str]:
    """Writes what was solved into the scene's lights, and makes the new ones; strokes and places are done with. Returns
    what is to be said of it. Raises LookError or RefusedError, and has then written nothing."""
    outcome = looks.restore(scene, look.look(), lights=True)
    pairs.clear(scene)
    settings = scene.relume_solve
    # What was asked for is asked of how it was: once more would be twice as much.
    settings.strokes = ""
    settings.regions.clear()
    # A look has the world as a factor. In the world itself it would be there twice once the look is restored.
    world = [WORLD_STAYS for row in rows.present_rows(scene) if row.kind == WORLD and not is_neutral(row.values())]
    if settings.report:
        report = json.loads(settings.report)
        notes = list(dict.fromkeys([*report["notes"], *world]))
        settings.report = json.dumps(report | {"applied": report["look"] == look.name, "notes": notes})
    return [words for words in (str(outcome), *world) if words]


@persistent
def cancel_all(*_arguments) -> None:
    """Ends everything: another file is about to be opened, or the add-on is disabled."""
    for solving in list(_running.values()):
        solving.cancel()


def register():
    """Ends solving with its file."""
    bpy.app.handlers.load_pre.append(cancel_all)


def unregister():
    """Ends solving."""
    cancel_all()
    bpy.app.handlers.load_pre.remove(cancel_all)
