"""Solving in the background of Blender's window: a step at a time, with previews, until a result is there.

Nothing here writes to lights. The window keeps the result as a look, and `relume.apply_solved` writes it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ...core import coverage
from ...core import solve as core
from ...core.background_call import run_in_thread
from ...core.progress import share_and_words
from ...core.solve import SolveError
from ...core.status import STAGES, is_final
from ...core.strokes import Stroke, goals
from ...core.words import listed
from ...export.target import resized
from ..shot import requests
from ..shot import shot as shots
from ..workers.pictures import Reading
from . import handle, new_paths, previews, region_masks, target_image
from .request import TARGET, inputs_of
from .stroke_shots import views_of

PREVIEW_SECONDS = 0.4
"""Seconds between previews: the picture needs the processor as well."""
PICTURE_SECONDS = 60.0
"""Longest wait for the picture of the result; without it the look has no thumbnail."""
STEP_SECONDS = 0.03
"""Seconds between steps where nobody sees them."""
COARSE = (160, 90)
"""Size of the masks that tell if anything is left of a stroke."""
UNCERTAIN, REBAKE = "so the result is uncertain", "Rebake, then solve again"

_running: dict[int, Solving] = {}
"""Running jobs by the session uid of their scene."""


@dataclass(frozen=True)
class Hooks:
    """Functions of the window that a job calls."""

    show_present: Callable[[bpy.types.Scene], None]
    """Asks for the picture of the scene's own lights."""
    wake: Callable[[], None]
    """Has new pictures polled again."""
    keep: Callable[[Solving, Result], Generator[None, None, str]]
    """Keeps a result as a look, over several steps; returns the look's UID."""


@dataclass(frozen=True)
class Result:
    """Result of a job."""

    answer: dict[str, Any]
    """The solver's answer."""
    content: dict[str, Any]
    """Content of the request for the picture that the job started at."""
    asked: dict[str, Any]
    """The solver's request."""
    picture_request: str
    """Request for the picture of the answer."""
    frame: Any
    """Picture of the answer; None if it did not come in time."""
    before_frame: Any
    """Picture that the job started at; None if there was no final one."""


class Solving:
    """Job that solves the lights of one scene."""

    def __init__(self, scene: bpy.types.Scene, shot: shots.Shot, content: dict[str, Any], hooks: Hooks):
        """Starts at the picture of `content`. Raises SolveError."""
        self.shot, self.uid = shot, scene.session_uid
        self.progress: tuple[float, str] = (0.0, "Looking at the goals")
        self.entry = ""
        """UID of the look with the result."""
        inputs = inputs_of(scene, content)
        self.notes = inputs.notes
        self._hooks, self._content = hooks, content
        self._options = inputs.options
        self.views = views_of(scene, shot, inputs.strokes)
        self._size = target_image.picture_size(scene)
        self._images: dict[str, np.ndarray] = {}
        self._subjects = inputs.subjects
        self._readings = {name: Reading(scene, image, self._size, None) for name, image in inputs.images.items()}
        self._request: dict[str, Any] = {}
        frame = shot.present_frame
        self._before_frame = frame if frame is not None and is_final(frame) else None
        self._job: Any = None
        self._work = self._run()

    @property
    def is_running(self) -> bool:
        """True until it has ended, whatever scene is shown."""
        return _running.get(self.uid) is self

    def step(self) -> bool:
        """Continues for a moment; returns True if more is to be done. An exception ends the job; SolveError is for the
        artist."""
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

    def run_to_end(self) -> None:
        """Solves to the end, for scripts without a window. Raises SolveError."""
        while self.step():
            self.shot.poll()
            time.sleep(STEP_SECONDS)

    def cancel(self) -> None:
        """Ends the job and shows the lights as they are."""
        _running.pop(self.uid, None)
        if self._job is not None:
            self._job.cancel()
        self._work.close()
        for reading in self._readings.values():
            reading.close()
        scene = self.scene()
        if scene is not None:
            self._hooks.show_present(scene)

    def scene(self) -> bpy.types.Scene | None:
        """The scene, which undo may have replaced; None if another file has removed it."""
        return next((scene for scene in bpy.data.scenes if scene.session_uid == self.uid), None)

    def _run(self) -> Generator[None, None, None]:
        by_view = yield from run_in_thread(lambda: [_stroke_goals(view.strokes) for view in self.views])
        goals = self._choose_views(by_view)
        self._request = core.request(self._content, replace(self._options, goals=[*goals, *self._options.goals]))
        yield from self._read_pictures()
        yield from self._make_masks()
        self._job = handle.start(self.shot, self._request, self._images, [view.folder for view in self.views])
        yield from self._wait_for_job()
        answer = handle.answer(self._job)
        is_current_alone = [view.name for view in self.views] == [""]
        if is_current_alone and core.moved_out_of_sight(answer, self._request["lights"]):
            answer = yield from self._solve_on(answer)
        elif answer["rarely_met"]:
            self.notes.append(f"Few paths meet {listed(answer['rarely_met'])}, {UNCERTAIN}: {REBAKE}")
        self.progress = (1.0, "Making the picture")
        request = core.picture_request(answer, self._content["static"])
        text = json.dumps(request | {"interactive": False})
        previews.show_beside(self.scene(), self.shot, request)
        frame = yield from self._picture(text)
        result = Result(answer, self._content, self._request, text, frame, self._before_frame)
        self.entry = yield from self._hooks.keep(self, result)

    def _choose_views(self, by_view: list[list[dict[str, Any]]]) -> list[dict[str, Any]]:
        """Leaves out views of which nothing is asked; the goals of strokes with the numbers of the others."""
        is_current_asked = bool(self._options.goals) or self._options.keep_rest > 0.0
        asked = [bool(goals) or (not number and is_current_asked) for number, goals in enumerate(by_view)]
        self.views = [view for view, is_asked in zip(self.views, asked, strict=True) if is_asked]
        chosen = [goals for goals, is_asked in zip(by_view, asked, strict=True) if is_asked]
        return [goal | ({"view": view} if view else {}) for view, goals in enumerate(chosen) for goal in goals]

    def _solve_on(self, answer: dict[str, Any]) -> Generator[None, None, dict[str, Any]]:
        """The answer, polished with paths that look for its lights; unchanged where there can be none."""
        names = listed(answer["rarely_met"])
        try:
            polished = yield from self._polished(answer)
        except (SolveError, OSError) as error:
            self.notes.append(f"Few paths meet {names}, {UNCERTAIN}: {error}")
            return answer
        self.notes.append(f"Few paths of the bake meet {names}; Rebake traces paths that look there")
        return polished

    def _polished(self, answer: dict[str, Any]) -> Generator[None, None, dict[str, Any]]:
        scene = self.scene()
        if scene is None:
            return answer
        self.progress = (0.0, "Looking for the lights")
        with new_paths.folder_in(self.shot) as folder:
            work = new_paths.bake(scene, self.shot, answer["lights"]["lights"], folder)
            is_there = yield from self._wait_for_paths(work)
            if not is_there:
                raise SolveError(REBAKE)
            request = self._request | {"from": answer, "steps": 0, "starts": 1}
            self._job = handle.start(self.shot, request, self._images, [folder])
            try:
                yield from self._wait_for_job()
            except GeneratorExit:  # It reads from the folder.
                new_paths.cancel(self._job, folder)
                raise
            return handle.answer(self._job)

    def _wait_for_paths(self, work: Generator[Any, None, bool]) -> Generator[None, None, bool]:
        try:
            while True:
                job = next(work)
                if job is not None:
                    self._report(job, "Looking for the lights")
                yield
        except StopIteration as end:
            return end.value
        finally:
            work.close()

    def _read_pictures(self) -> Iterator[None]:
        """Reads the target and masks."""
        scene = self.scene()
        if scene is not None and scene.relume_solve.target is not None:
            self.progress = (0.0, "Reading the target")
            picture = yield from target_image.awaited(scene)
            self._images[TARGET] = picture.pixels
            self.notes += [picture.words] * picture.is_doubtful
        for name, reading in self._readings.items():
            self.progress = (0.0, "Reading masks")
            while reading.step():
                yield
            if reading.found is None:
                raise SolveError(reading.error)
            self._images[name] = reading.found.pixels

    def _make_masks(self) -> Iterator[None]:
        """Makes the masks of objects and materials."""
        if not self._subjects:
            return
        self.progress = (0.0, "Looking for objects")
        masks: dict = {}
        width, height = self._size
        for made in region_masks.masks(self.uid, list(self._subjects.values()), width / height):
            masks = made or {}
            yield
        for name, subject in self._subjects.items():
            hidden = self._not_shown(subject)
            if subject not in masks or not masks[subject].any():
                raise SolveError(f"Not seen in the picture: {subject}{f', {hidden}' if hidden else ''}")
            if hidden:
                self.notes.append(f"Only a part of {subject} is looked at, {hidden}")
            mask = resized(masks[subject], self._size)
            self._images[name] = np.ascontiguousarray(mask, np.float32)

    def _not_shown(self, subject: region_masks.MaskSubject) -> str:
        """Reason why the window hides something from a mask; empty if it does not."""
        scene = self.scene()
        names = region_masks.not_shown(scene, subject) if scene is not None else []
        return f"since {', '.join(map(repr, names))} is hidden in the view; show it and solve again" if names else ""

    def _wait_for_job(self) -> Iterator[None]:
        next_preview = 0.0
        while not self._job.done:
            self._report(self._job)
            if time.monotonic() >= next_preview:
                preview = self._job.preview()
                if preview is not None:
                    self._show_preview(preview)
                    next_preview = time.monotonic() + PREVIEW_SECONDS
            yield

    def _report(self, job: Any, words: str = "") -> None:
        """Notes the progress of a job; without `words` they are those of its stage."""
        report = job.progress()
        if report is not None:
            share, so_far = share_and_words(report)
            self.progress = (share, f"{words or STAGES.get(report['stage'], 'Solving')}, {so_far}")

    def _show_preview(self, preview: dict[str, Any]) -> None:
        """Shows the best lights and world so far, in all views that show shots."""
        request = core.picture_request(preview, self._content["static"])
        self.shot.ask(requests.kept_request(json.dumps(request | {"interactive": True})))
        previews.show_beside(self.scene(), self.shot, request)
        self._hooks.wake()

    def _picture(self, request: str) -> Generator[None, None, Any]:
        """Waits for the picture of the result and returns it; None where it does not come."""
        number, end = self.shot.ask(requests.kept_request(request)), time.monotonic() + PICTURE_SECONDS
        self._hooks.wake()
        while time.monotonic() < end and self.shot.is_open and self.shot.can_show:
            frame = self.shot.frame
            if frame is not None and frame.request == number and is_final(frame):
                return frame
            if frame is not None and frame.request > number:  # Something was edited meanwhile.
                number = self.shot.ask(requests.kept_request(request))
                self._hooks.wake()
            yield
        return None


def _stroke_goals(strokes: tuple[Stroke, ...]) -> list[dict[str, Any]]:
    """Goals of strokes, without what was erased altogether."""
    covered = coverage.layers(strokes, COARSE).values()
    return [goal for goal, layer in zip(goals(strokes), covered, strict=True) if layer.any()]


def ready_shot(scene: bpy.types.Scene) -> shots.Shot:
    """Shot of a scene in which lights can be solved now. Raises SolveError with one line for the artist."""
    if running(scene) is not None:
        raise SolveError("Lights are being solved already")
    shot = shots.of(scene)
    if shot is None:
        raise SolveError("Press Start first: lights are solved in the paths of a bake")
    if not shot.status.live.samples:
        raise SolveError("Wait for the first picture")
    if shot.is_changing_world or not shot.status.live.world_is_stored:
        raise SolveError("The world has changed: wait until its light is gathered from all paths")
    return shot


def begin(scene: bpy.types.Scene, shot: shots.Shot, content: dict[str, Any], hooks: Hooks) -> Solving:
    """Begins to solve; to be stepped until it ends. Raises SolveError with one line for the artist."""
    solving = _running[scene.session_uid] = Solving(scene, shot, content, hooks)
    return solving


def running(scene: bpy.types.Scene) -> Solving | None:
    """Job that solves a scene; None if there is none."""
    return _running.get(scene.session_uid)


@persistent
def cancel_all(*_arguments) -> None:
    """Ends all jobs: another file is about to be opened, or the add-on is disabled."""
    for solving in list(_running.values()):
        solving.cancel()
