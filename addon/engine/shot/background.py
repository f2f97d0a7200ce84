"""Jobs of a shot in a Blender of their own, such as its bake: they go on while the artist works, and while other files
are open. What one has written stays when it is stopped, and the next start goes on from there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ...core import bake_goal
from ...core.shots import ListedShot
from ..native import native
from ..workers.process import SavedCopy, Worker, blender_command
from . import shot, shot_list
from .options import Options, options_of

LIGHTS_FILE = "lights.json"
MIB = 2**20
STOPPED = "stopped; start it again to go on"


class BackgroundError(Exception):
    """The background bake cannot be started; the message says why."""


class BackgroundJob:
    """Commands that other Blenders run one after the other for a scene."""

    def __init__(
        self, scene_uid: int, scene_name: str, folder: Path, steps: list[list[str]], copy: SavedCopy | None = None
    ):
        """`steps` are the words of each command that writes into `folder`. The first one reads `copy`, the file as it
        was; whoever made that removes it."""
        self.scene_uid, self.name = scene_uid, scene_name
        self.folder = folder
        self.stage: dict[str, Any] = {"stage": "prepare", "done": 0, "total": 1, "remaining_s": None, "message": ""}
        self.warnings: list[str] = []
        self.result: dict[str, Any] = {}
        """Result of the last command."""
        self.error = ""
        self.done = False
        self._stopped = False
        self._copy, self._steps = copy, steps
        self._worker: Worker | None = None
        if steps:
            self._start_next()

    @property
    def is_running(self) -> bool:
        """True until the job has ended."""
        return not (self.done or self.error)

    @property
    def title(self) -> str:
        """Name for the artist."""
        return self.name

    @property
    def bake(self) -> Path | None:
        """Bake folder that it has made, if the scene is to show one."""
        return None

    @property
    def done_words(self) -> str:
        """Message for the artist once it has ended well."""
        return ""

    def poll(self) -> bool:
        """Takes the output of the other Blender; returns True if there was any."""
        if not self.is_running:
            return False
        worker = self._worker
        ended, events = (True, []) if worker is None else (worker.ended, worker.events())
        for event in events:
            self._take(event)
        if ended:
            self._next_step()
        return ended or bool(events)

    def _take(self, event: dict[str, Any]) -> None:
        kind = event.get("event")
        if kind == "progress":
            self.stage = event
        elif kind == "warning":
            self.warnings.append(event["message"])
        elif kind == "result":
            self.result = event

    def _next_step(self) -> None:
        self.error = self._failure()
        if not self.error:
            try:
                self._go_on()
            except (OSError, ValueError, KeyError) as error:
                self.error = f"it could not go on: {error}"

    def _failure(self) -> str:
        """Why the step that has ended failed; empty if it went well."""
        if self._worker is None or self._worker.code == 0:
            return ""
        return STOPPED if self._stopped else self._worker.failure()

    def _go_on(self) -> None:
        """Starts what follows a step that went well; there may be nothing."""
        if self._steps:
            self._start_next()
        else:
            self.done = True

    def _start_next(self) -> None:
        arguments = self._steps.pop(0)
        command = blender_command(self._copy.blend if self._copy else None, arguments)
        self._copy = None
        self._worker = Worker(command, self.folder)

    def cancel(self) -> None:
        """Asks the other Blender to end; what is there stays."""
        self._stopped = True
        self._steps.clear()
        if self._worker is not None:
            self._worker.stop()

    def close(self) -> None:
        """Ends it at once. Files are whole at every moment."""
        self._stopped = True
        if self._worker is not None:
            self._worker.kill()
            self._worker.events()
        self.error = self.error or STOPPED


class BackgroundBake(BackgroundJob):
    """The bake of one shot: tracing first, then a training for each type of light. The Blender that traces it may trace
    others beside it, as it has read their scene."""

    def __init__(
        self,
        scene_uid: int,
        scene_name: str,
        wanted: ListedShot,
        options: Options,
        copy: SavedCopy | None,
        beside: tuple[ListedShot, ...] = (),
    ):
        """`copy` is None for a shot that was traced `beside` another one."""
        self.options, self.wanted, self._is_traced = options, wanted, copy is None
        self._beside = beside
        self.traced: set[str] = set()
        """Names of the shots that its Blender has traced."""
        self.present, self.ahead = wanted.name, 0
        """Name of the shot that is being baked, and how many its Blender has left behind."""
        self._failures: dict[str, str] = {}
        steps = self._training() if copy is None else [self._bake_arguments(scene_name)]
        super().__init__(scene_uid, scene_name, options.folder, steps, copy)

    @property
    def title(self) -> str:
        """Name for the artist."""
        if self.wanted.key:
            return f"{self.name}, shot {self.wanted.name}"
        return f"{self.name}, camera {self.wanted.camera}"

    @property
    def bake(self) -> Path | None:
        """The bake folder."""
        return self.folder

    @property
    def done_words(self) -> str:
        """Words that say where the bake is."""
        return f"The background bake is ready in '{self.folder}'"

    def _take(self, event: dict[str, Any]) -> None:
        if "baked" in event:
            self.traced, self._failures = set(event["baked"]), event.get("failed", {})
        if event.get("stage") == "shots":
            self.present, self.ahead = event["message"], event["done"]
        else:
            super()._take(event)

    def _failure(self) -> str:
        if self._is_traced or self._stopped:
            return super()._failure()
        is_traced = self.wanted.name in self.traced
        return "" if is_traced else self._failures.get(self.wanted.name) or super()._failure()

    def _go_on(self) -> None:
        if not self._is_traced:
            self._is_traced, self.present, self.ahead = True, self.wanted.name, 0
            self._steps += self._training()
        if not self._steps:
            bake_goal.forget(self.folder)
        super()._go_on()

    def _bake_arguments(self, scene_name: str) -> list[str]:
        options, found = self.options, (self.wanted, *self._beside)
        folders = json.dumps({shot.name: str(shot.folder) for shot in found})
        alone = ["--out", str(options.folder), *shot_list.arguments(self.wanted), "--samples", str(options.samples)]
        what = ["--folders", folders] if self._beside else alone
        how = ["--resume", "--replace", "--json", "--threads", str(options.threads)]
        return ["bake", "--scene", scene_name, *what, *how]

    def _training(self) -> list[list[str]]:
        """Commands that learn what is traced; notes what is wanted, for who goes on where they are interrupted."""
        bake_goal.BakeGoal(self.options.samples, self.options.train_seconds).write(self.options.folder)
        return [self._train_arguments(kind) for kind in self._kinds()]

    def _train_arguments(self, kind: str) -> list[str]:
        options = self.options
        command = ["train", str(options.folder), "--type", kind, "--seconds", str(options.train_seconds), "--resume"]
        memory = ["--gpu-memory", str(options.gpu_memory // MIB)] if options.gpu_memory else []
        return [*command, "--json", "--threads", str(options.threads), "--device", options.device, *memory]

    def _kinds(self) -> list[str]:
        """Types of light that the baked scene has and that proxies answer for."""
        if self.options.train_seconds <= 0.0:
            return []
        lights = json.loads((self.options.folder / LIGHTS_FILE).read_text(encoding="utf-8"))["lights"]
        return sorted({kind for light in lights if (kind := native().Light(light).kind)})


class Batch:
    """Shots of a scene as it is now, baked one after the other. One that fails keeps no other from being baked."""

    def __init__(self, scene: bpy.types.Scene, wanted: list[tuple[ListedShot, Options]]):
        self.scene_uid, self.name = scene.session_uid, scene.name
        self.waiting, self.count = wanted, len(wanted)
        self.baked: list[str] = []
        """Names of the shots that are done."""
        self.traced: set[str] = set()
        """Names of those that need only be learned: a Blender has traced them beside another one."""
        self.failures: dict[str, str] = {}
        """Errors by the names of the shots."""
        self.job: BackgroundBake | None = None
        self._copy: SavedCopy | None = SavedCopy(scene)

    @property
    def is_running(self) -> bool:
        """True until all shots have had their turn."""
        return self._copy is not None

    def poll(self) -> bool:
        """Goes on to the next shot where one has ended; returns True if it did. The jobs themselves are polled by
        whoever polls all of them."""
        if not self.is_running or (self.job is not None and self.job.is_running):
            return False
        if self.job is not None:
            self._note(self.job)
        self.job = None
        while self.waiting and self.job is None:
            shot, options = self.waiting.pop(0)
            try:
                self.job = _begin(self, shot, options)
            except OSError as error:
                self.failures[shot.name] = str(error)
        if self.job is None:
            self._end()
        return True

    @property
    def folders(self) -> set[Path]:
        """Folders that are written to, or will be."""
        present = {self.job.folder} if self.job is not None and self.job.is_running else set()
        return present | {options.folder for _, options in self.waiting}

    def copy(self) -> SavedCopy:
        """The file as it was when the batch began."""
        assert self._copy is not None
        return self._copy

    def _note(self, job: BackgroundBake) -> None:
        self.traced |= job.traced
        if job.error:
            self.failures[job.wanted.name] = job.error
        else:
            self.baked.append(job.wanted.name)

    def cancel(self) -> None:
        """Asks the present shot to stop and leaves the others out."""
        self.failures |= {shot.name: STOPPED for shot, _ in self.waiting}
        self.waiting.clear()
        if self.job is not None and self.job.is_running:
            self.job.cancel()

    def close(self) -> None:
        """Ends it at once."""
        self.waiting.clear()
        if self.job is not None and self.job.is_running:
            self.job.close()
        self._end()

    def _end(self) -> None:
        if self._copy is not None:
            self._copy.remove()
            self._copy = None


_jobs: list[BackgroundJob] = []
_batches: list[Batch] = []


def _begin(batch: Batch, wanted: ListedShot, options: Options) -> BackgroundBake:
    """Starts the job of one shot; it replaces the last one of its scene, if that has ended. Those that wait and may
    have the same scene are traced with it."""
    _forget_jobs(batch.scene_uid)
    copy = None if wanted.name in batch.traced else batch.copy()
    alike = (shot for shot, _ in batch.waiting if shot.state == wanted.state and shot.name not in batch.traced)
    beside = tuple(alike) if copy is not None else ()
    job = BackgroundBake(batch.scene_uid, batch.name, wanted, options, copy, beside)
    _jobs.append(job)
    return job


def start(scene: bpy.types.Scene) -> BackgroundBake:
    """Starts a job for the current shot of a scene that can be baked (`checks.check_start`). It replaces the scene's
    last one, if that has ended."""
    found = shot.of(scene)
    if found is not None and found.is_working:
        raise BackgroundError("this shot is being traced already; cancel that first")
    batch = start_all(scene, [(shot_list.current(scene), options_of(scene))])
    if batch.job is None:
        raise OSError("; ".join(batch.failures.values()))
    return batch.job


def start_all(scene: bpy.types.Scene, wanted: list[tuple[ListedShot, Options]]) -> Batch:
    """Starts a batch of shots that can be baked. Raises NoCopyError."""
    forget(scene)
    batch = Batch(scene, wanted)
    _batches.append(batch)
    batch.poll()
    return batch


def start_other(scene: bpy.types.Scene, kind: Callable[[bpy.types.Scene], BackgroundJob]) -> BackgroundJob:
    """Starts a job that is no bake. It replaces the scene's last one, if that has ended."""
    forget(scene)
    job = kind(scene)
    _jobs.append(job)
    return job


def batch_of(scene: bpy.types.Scene) -> Batch | None:
    """The newest batch of a scene."""
    return next((batch for batch in reversed(_batches) if batch.scene_uid == scene.session_uid), None)


def all_batches() -> list[Batch]:
    """All batches, also those of files that are not open any more."""
    return list(_batches)


def of(scene: bpy.types.Scene) -> BackgroundJob | None:
    """The job of a scene."""
    return next((job for job in _jobs if job.scene_uid == scene.session_uid), None)


def all_jobs() -> list[BackgroundJob]:
    """All jobs, also those of files that are not open any more."""
    return list(_jobs)


def forget(scene: bpy.types.Scene) -> None:
    """Forgets what has ended of a scene."""
    uid = scene.session_uid
    _forget_jobs(uid)
    _batches[:] = [batch for batch in _batches if batch.is_running or batch.scene_uid != uid]


def _forget_jobs(scene_uid: int) -> None:
    _jobs[:] = [job for job in _jobs if job.is_running or job.scene_uid != scene_uid]


def close_all() -> None:
    """Ends and forgets all jobs."""
    for batch in _batches:
        batch.close()
    for job in _jobs:
        if job.is_running:
            job.close()
    _batches.clear()
    _jobs.clear()
