"""A shot that Relume works on. Everything here returns at once; the native module works on threads of its own and is
polled."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Collection
from typing import Any

import bpy

from ...core.bake_folder import camera_of, world_map_of
from ...core.diff import Fingerprint
from ...core.phase import BEFORE_BAKE, TRACING, WORKING, ShotPhase, next_phase
from ...core.shot_status import ShotStatus
from ...core.shots import AUTOMATIC
from ...core.status import is_unfinished, lacks_samples
from ...core.words import Kind, by_kind, grouped
from ...export import ExportOptions, trace_settings
from ...export.linking import receiver_names
from ...export.stop import ExportCancelled
from ..native import native
from ..reading.render_depsgraph import RenderTask
from ..reading.scene import load_scene_async
from ..reading.scene_lights import Description, SceneLights
from ..staleness import fingerprints
from ..staleness.tracker import StalenessTracker
from ..world import worlds
from ..world.world_follower import WorldFollower
from . import open_shots, record
from .options import Options, options_of, remember_bake, remembered_bake
from .passes import Passes, Whole
from .remaining_work import RemainingWork
from .requests import request

LIVELY_SECONDS = 2.0


class Shot:
    """Bake of one camera of a scene, and the work on it."""

    def __init__(self, scene: bpy.types.Scene, options: Options, kept: record.Record | None):
        self.scene_uid = scene.session_uid
        self.folder = options.folder
        self.options = options
        self.camera = kept.camera if kept else scene.camera.name if scene.camera else ""
        """Name of the camera that the bake is of, as it is called now."""
        self._camera_uid = scene.camera.session_uid if scene.camera and not kept else None
        self.status = ShotStatus(native().LiveStatus(), ShotPhase.READING)
        self.frame: Any = None
        """The newest picture."""
        self.frame_before: Any = None
        """The last picture of the bake that this one replaces."""
        self.warnings: list[str] = []
        self.lights = SceneLights(_view_layer(scene), kept.receivers if kept else receiver_names(scene))
        self.lights = open_shots.same_lights(self) or self.lights
        self.is_seen = True
        """False while views show other shots of the scene, and not this one: nobody follows a drag in it."""
        self.is_seen_beside = False
        """True while a view shows it through a camera of its own."""
        self.changes = StalenessTracker(kept.fingerprints if kept else None, self._of_view)
        self.changes.maps |= kept.maps if kept else {}
        self.is_recorded = kept is not None
        self._remaining = RemainingWork(options)
        self._task: RenderTask | None = None
        self._world = WorldFollower(self.changes)
        self._read_world = ""
        """Shape of the world's fingerprint when reading the scene began."""
        self._content: dict[str, Any] = {}
        """Content of the newest request; empty if that is not the present lights and rows."""
        self._is_interactive = self._anew = False
        self.refusal = ""
        """Why the newest request has no picture."""
        self._request_number = self._whole_number = 0
        """Numbers of the newest request, and of the first one with the present content."""
        self.serial = 0
        """Serial of the newest frame, of the whole picture or of a pass."""
        self._passes = Passes(self._ask_content)
        self._live_status: Any = None
        """Newest status of the native module."""
        self._news = time.monotonic()
        self.live = native().Live(
            str(options.folder),
            device=options.device,
            gpu_memory=options.gpu_memory,
            threads=options.threads,
            board=open_shots.board(),
        )
        """Native module's work on it."""

    @classmethod
    def start(cls, scene: bpy.types.Scene, anew: bool = False, options: Options | None = None) -> Shot:
        """Exports the scene and bakes it with its options or others; goes on with an interrupted bake of the same
        scene. A whole one is traced `anew` if its paths look for lights where they no longer are."""
        before = of(scene)
        if before is not None:
            before.changes.reload_images()
        shot = cls(scene, options or options_of(scene), None)
        shot._replace_current(scene)
        shot._anew = anew
        shot._export(scene)
        return shot

    @classmethod
    def open(cls, scene: bpy.types.Scene, beside: Any = None) -> Shot:
        """Takes the bake that the file remembers, or else what the scene's folder holds: of the current shot, or of an
        entry of the list, `beside` it."""
        options = options_of(scene, beside)
        folder = remembered_bake(scene, options.shot if beside is not None else None) or options.folder
        shot = cls(scene, dataclasses.replace(options, folder=folder), record.read(folder))
        if beside is None:
            shot._replace_current(scene)
        shot.is_recorded = True
        shot._enter(ShotPhase.PREPARING)
        shot._remaining.read()
        if shot.changes.is_recording:
            shot._camera_uid = None
            shot.warnings.append("This bake says nothing of its scene: what changed before it was opened is not seen")
        shot._find_camera(scene, camera_of(folder))
        if shot.camera not in scene.objects:
            words = f"Camera '{shot.camera}' of this bake is not in the scene"
            shot.warnings.append(f"{words}: if it was renamed, give it that name again; else start anew")
        shot.live.open()
        if beside is not None:
            open_shots.add_beside(shot)
        return shot

    def _replace_current(self, scene: bpy.types.Scene) -> None:
        """Takes the place of the scene's current shot, and of the one of the same entry of the list."""
        before = of(scene)
        if before is not None and before.camera == self.camera:
            self.frame_before = before.picture
        for other in open_shots.beside(scene):
            if other.key == self.key:
                other.close()
        open_shots.add_current(self)

    @property
    def key(self) -> str:
        """Key of the listed shot."""
        return self.options.shot

    def _of_view(self, scene: bpy.types.Scene) -> dict[str, Fingerprint] | None:
        """Fingerprints of the camera and film of a listed shot; None for the scene's own."""
        camera = scene.objects.get(self.camera) if self.key != AUTOMATIC else None
        return None if camera is None else fingerprints.of_view(scene, camera, self.options.resolution)

    def _export(self, scene: bpy.types.Scene) -> None:
        """Reads the scene, in a window on another thread, then bakes it."""
        if bpy.app.background:
            self._load(scene)

    def begin_reading(self, scene: bpy.types.Scene) -> bool:
        """Begins to read the scene in a window, if that was asked for; returns True if it did. Blender's operator that
        begins a render takes its time, and should have a tick to itself."""
        if not self.is_reading or self._task is not None or bpy.app.is_job_running("RENDER"):
            return False
        self._load(scene)
        return True

    def _scene(self) -> bpy.types.Scene | None:
        return next((scene for scene in bpy.data.scenes if scene.session_uid == self.scene_uid), None)

    def _load(self, scene: bpy.types.Scene) -> None:
        settings = trace_settings(scene, self.warnings.append)
        settings |= {"samples": self.options.samples, "threads": self.options.threads}
        self._read_world = fingerprints.world(scene)["shape"]
        self._task = load_scene_async(
            scene,
            ExportOptions(resolution=self.options.resolution),
            lambda exported, error: self._exported(exported, error, settings),
        )

    def _exported(self, exported: Any, error: BaseException | None, settings: dict[str, Any]) -> None:
        task, self._task = self._task, None
        if not self.is_open:
            return
        if isinstance(error, ExportCancelled) and task is not None and task.is_displaced and not task.cancelled:
            return  # The scene is read again after the other render.
        try:
            if error is not None:
                raise error
            self._bake(exported, settings)
        except ExportCancelled:
            self._enter(ShotPhase.INTERRUPTED)
        except Exception as problem:
            self._enter(ShotPhase.UNREAD, str(problem) or repr(problem))

    def _bake(self, exported: Any, settings: dict[str, Any]) -> None:
        self.warnings += exported.warnings
        self._note_world_of(exported)
        # Until now the bake in the folder was the one before.
        record.forget(self.folder)
        if scene := self._scene():
            remember_bake(scene, self.folder, self.options.shot)
        self._remaining.note_bake()
        self.live.bake(exported, settings, train_seconds=self.options.train_seconds, anew=self._anew)
        self._enter(ShotPhase.PREPARING)

    def _note_world_of(self, exported: Any) -> None:
        """Notes the world that was read under the shape of its fingerprint, if that did not change meanwhile."""
        scene = self._scene()
        if scene is not None and fingerprints.world(scene)["shape"] == self._read_world:
            self.changes.maps[exported.world_map] = self._read_world

    def _enter(self, phase: ShotPhase, error: str | None = None) -> None:
        error = error or self.status.error
        self.status = dataclasses.replace(self.status, phase=next_phase(self.phase, phase), error=error)

    def give_up_reading(self) -> None:
        """Ends the interruption of reading, once it was noticed."""
        self._enter(ShotPhase.UNREAD)

    def _find_camera(self, scene: bpy.types.Scene, baked: str) -> None:
        """Finds the camera of a bake that was opened: it may have been renamed since, in a file that was not saved."""
        known = self.camera if self.changes.baked else ""
        self.camera = next((name for name in (known, baked) if name in scene.objects), known or baked or self.camera)
        if self.camera != known and self.camera in scene.objects:
            self.changes.rename_camera(scene.objects[self.camera].name_full)

    def recognises(self, camera: bpy.types.Object) -> bool:
        """True if the bake is of this camera. It is found by its name once, and then known by its uid under any
        name."""
        if camera.session_uid != self._camera_uid:
            if camera.name != self.camera or self._camera_exists():
                return False
            self._camera_uid = camera.session_uid
        if camera.name != self.camera:
            self.camera = camera.name
            self.changes.rename_camera(camera.name_full)
            self.is_recorded = self.is_recorded and self.changes.is_recording
        return True

    def _camera_exists(self) -> bool:
        uid = self._camera_uid
        return uid is not None and any(obj.session_uid == uid for obj in bpy.data.objects)

    @property
    def phase(self) -> ShotPhase:
        """Present phase."""
        return self.status.phase

    @property
    def is_reading(self) -> bool:
        """True while the scene is read, or soon will be."""
        return self.phase is ShotPhase.READING

    @property
    def is_open(self) -> bool:
        """True until the shot is closed."""
        return any(shot is self for shot in all_open())

    @property
    def is_stored(self) -> bool:
        """True if the folder holds something of this shot, or soon will."""
        return self.phase not in BEFORE_BAKE

    @property
    def is_working(self) -> bool:
        """True while something is being baked or trained."""
        return self.phase in WORKING

    @property
    def is_tracing(self) -> bool:
        """True while paths are being traced, or the scene is read for that."""
        return self.phase in TRACING

    @property
    def picture(self) -> Any:
        """Newest picture; before there is one, that of the bake before."""
        return self.frame or (self.frame_before if self.is_working else None)

    @property
    def pictures(self) -> list[Any]:
        """All that views may show."""
        return [self.picture, *self._passes.turns.pictures.values()]

    def picture_of(self, name: str) -> Any:
        """Newest picture of a pass; the whole picture as long as there is none, or no such light."""
        return self._passes.turns.pictures.get(name, self.picture)

    @property
    def present_frame(self) -> Any:
        """The picture of the present lights and rows, in any size; None while it is on its way, and while that of a
        look or of lights that are being solved is asked for instead."""
        is_asked_for = bool(self._content) and not self.is_changing_world and not self.lights.is_waiting
        is_present = is_asked_for and self.frame is not None and self.frame.request >= self._whole_number
        return self.frame if is_present else None

    @property
    def is_changing_world(self) -> bool:
        """True while another world than the present one is still shown."""
        return self._world.is_behind

    @property
    def can_show(self) -> bool:
        """True if requests have pictures, now or as soon as there are paths. After a failure, what was baked before it
        is shown."""
        live = self.status.live
        has_failed = self.phase in {ShotPhase.INTERRUPTED, ShotPhase.UNREAD, ShotPhase.CLOSED}
        is_empty = not (live.samples or live.proxies or live.shown)
        return not (has_failed or (self.phase is ShotPhase.FAILED and is_empty))

    @property
    def is_busy(self) -> bool:
        """True if a newer status or picture is to be expected."""
        if not self.can_show:
            return False
        shown = self.status.live.shown or {}
        waits = shown.get("request", 0) < self._request_number or not shown.get("settled", True)
        return self.is_working or waits or self._world.is_reading or self.lights.is_waiting

    @property
    def is_lively(self) -> bool:
        """True if a status or picture came within the last seconds."""
        return time.monotonic() - self._news < LIVELY_SECONDS

    @property
    def notes(self) -> list[str]:
        """Notes for the artist, each once: features that Relume cannot represent, warnings, and the reason for a
        missing picture."""
        return list(grouped(self._all_warnings()))

    @property
    def warnings_by_kind(self) -> tuple[Kind, ...]:
        """The notes for a list that can be unfolded."""
        return by_kind(self._all_warnings())

    def _all_warnings(self) -> tuple[str, ...]:
        refusal = [self.refusal] * bool(self.refusal)
        return (*refusal, *self.lights.warnings, *self.warnings, *self.status.live.warnings)

    def follow_world(self, scene: bpy.types.Scene) -> Any:
        """Makes the present world ready to be shown where another one is, a turn at a time; gives it to `relight` once
        it is."""
        task = None if self.is_reading else self._world.follow(scene)
        if task is None:
            return None
        self.warnings += task.world.warnings
        self.is_recorded = self.changes.is_recording
        self.keep_record()
        return task.world

    def relight(self, lights: list[Description], mix: dict, interactive: bool, world: Any = None) -> bool:
        """Asks for a picture; the newest request wins. `lights` as `SceneLights` describes them, `mix` as
        `core.rows.mix` does, and `world` as `follow_world` gives it, where there is another from now on. False if that
        is what was asked for before: Blender also tells of edits that change nothing."""
        content = {"lights": lights, **mix}
        same = content == self._content and world is None
        if same and (interactive or not self._is_interactive):
            return False
        try:
            self.ask(request(content, interactive), world)
        except ValueError as error:
            self.refusal = str(error)
            return False
        self.refusal = ""
        self._content, self._is_interactive = content, interactive
        return True

    def ask(self, asked: Any, world: Any = None) -> int:
        """Asks for the picture of a `relume.Request`, such as one that was kept; returns its number."""
        self._content = {}
        self._news = time.monotonic()
        live = self.live
        self._request_number = live.relight(asked) if world is None else live.show_world(world, asked)
        self._whole_number = self._request_number
        return self._request_number

    def show_passes(self, names: Collection[str]) -> None:
        """Shows the pictures of these passes only, one a tick, after the whole picture. Waits until all paths are
        traced, as these look for the lights of the newest request."""
        frame, status, whole = self.present_frame, self.status, None
        if frame is not None and self.can_show and not self.is_tracing:
            asked = self._content, self._is_interactive, self._whole_number
            whole = Whole(frame, *asked, status.live.samples, status.live.proxies)
        self._passes.follow(names, whole)

    def _ask_content(self, content: dict[str, Any], interactive: bool) -> int:
        self._request_number = self.live.relight(request(content, interactive))
        return self._request_number

    def poll(self) -> bool:
        """Takes the newest picture and status; returns True if there was anything new."""
        if self.phase in BEFORE_BAKE:
            return False
        live = self.live.status()
        frame = self.live.frame(self.serial)
        self.keep_record()
        if live == self._live_status and frame is None:
            return False
        self._news = time.monotonic()
        self._live_status = live
        if self._passes.turns.is_away:  # Until then the native module reports a pass.
            live = live.with_picture_of(self.status.live)
        phase = next_phase(self.phase, ShotPhase(live.state))
        status = self._remaining.note(ShotStatus(live, phase, live.error, live.samples_total, live.stage))
        is_under_another_world = self._is_under_another_world(status)
        self.status = dataclasses.replace(status, is_under_another_world=is_under_another_world)
        self.changes.note_world(self.status.live.world_map, self.status.live.world_color)
        if frame:
            self._take(frame)
        return True

    def _take(self, frame: Any) -> None:
        turns = self._passes.turns
        self.serial, was_away = frame.serial, turns.is_away
        if not turns.take(frame):
            self.frame, self.frame_before = frame, None
        if was_away and not turns.is_away:
            self._live_status = None  # Its description of the picture was left out.

    def _is_under_another_world(self, status: ShotStatus) -> bool:
        if not (is_unfinished(status) and lacks_samples(status)):
            return False
        return world_map_of(self.folder) not in {None, status.live.world_map}

    def resume_options(self, scene: bpy.types.Scene) -> Options:
        """Options to go on with what was asked for of this bake, in its folder."""
        options = dataclasses.replace(
            options_of(scene), folder=self.folder, samples=self.status.samples_total or self.options.samples
        )
        goal = self._remaining.goal
        return dataclasses.replace(options, train_seconds=goal.train_seconds) if goal else options

    def keep_record(self) -> None:
        """Writes what the bake is of, as soon as there is a bake and that is known."""
        if self.is_recorded or self.changes.is_recording or not self.status.live.samples:
            return
        self.is_recorded = True
        try:
            baked = self.changes.baked_fingerprints()
            record.Record(self.camera, self.lights.receivers, baked, self.changes.maps).write(self.folder)
        except OSError as error:
            self.warnings.append(f"What the bake is of could not be written down: {error}")

    @property
    def lacks_a_kind(self) -> bool:
        """True if a kind of light came into use after the goal was met, and could be learned as well. Lights that a
        look or the solver shows are not in use."""
        return bool(self._content) and not self._is_interactive and self._remaining.lacks_a_kind(self.status)

    def learn_kinds(self) -> None:
        """Learns the kinds of light that the bake lacks."""
        try:
            self.live.learn(self._remaining.note_kinds(self.status))
        except (OSError, RuntimeError) as error:
            self.warnings.append(f"The kind of light that was added is not learned: {error}")

    def attend(self) -> None:
        """Has its pictures made before those of other shots."""
        self.live.attend()

    def pause(self, paused: bool) -> None:
        """Lets baking and training stand still; relighting goes on."""
        self.live.pause(paused)

    def cancel(self) -> None:
        """Ends baking and training; what is there stays, relighting goes on."""
        if self._task is not None:
            self._task.cancel()
        elif self.is_reading:
            self._exported(None, ExportCancelled("cancelled"), {})
        self.live.cancel()

    def close(self, wait_seconds: float = 0.0) -> None:
        """Ends everything, without waiting unless told to. The folder stays whole."""
        open_shots.remove(self)
        self._enter(ShotPhase.CLOSED)
        if self._task is not None:
            self._task.cancel()
        self._world.close()
        self.live.close(wait_seconds=wait_seconds)
        self.frame = self.frame_before = None


def _view_layer(scene: bpy.types.Scene) -> str:
    return bpy.context.view_layer.name if bpy.context.scene == scene else scene.view_layers[0].name


def of(scene: bpy.types.Scene) -> Shot | None:
    """The current shot of a scene, if it is open."""
    return open_shots.of(scene)


def all_open() -> list[Shot]:
    """All open shots, the current ones first."""
    return open_shots.all_open()


def close_all(wait_seconds: float = 0.0) -> None:
    """Closes every shot: before another file is opened, and when the add-on is disabled."""
    for shot in all_open():
        shot.close(wait_seconds)
    worlds.forget()
