"""A shot that Relume works on: one for each scene. Everything here returns at once; the native module works on
threads of its own and is polled."""

from __future__ import annotations

import json
from typing import Any

import bpy

from ..export import ExportOptions, trace_settings
from .native import native
from .options import Options, options_of
from .scene import load_scene
from .scene_lights import SceneLights

EMPTY: dict[str, Any] = {
    "state": "empty",
    "paused": False,
    "stage": None,
    "samples": 0,
    "samples_total": 0,
    "proxies": {},
    "device": "",
    "warnings": [],
    "error": None,
    "shown": None,
}
WORKING = {"preparing", "baking", "training"}

_shots: dict[int, Shot] = {}


class Shot:
    """What is baked of a scene, and what is being done about it."""

    def __init__(self, scene: bpy.types.Scene, options: Options):
        self.scene_uid = scene.session_uid
        self.folder = options.folder
        self.options = options
        self.camera = scene.camera.name if scene.camera else ""
        self.status = dict(EMPTY)
        self.frame: Any = None
        self.warnings: list[str] = []
        self.lights = SceneLights(_view_layer(scene), [obj.name_full for obj in scene.objects])
        self.request = ""
        """The newest request, JSON."""
        self._request_number = 0
        self._status_text = ""
        self._live = native().Live(
            str(options.folder), device=options.device, gpu_memory=options.gpu_memory, threads=options.threads
        )

    @classmethod
    def start(cls, scene: bpy.types.Scene) -> Shot:
        """Exports the scene and bakes it into its folder; goes on with an interrupted bake of the same scene."""
        shot = cls._replace(scene)
        shot.status["state"] = "preparing"
        shot._export(scene)
        return shot

    @classmethod
    def open(cls, scene: bpy.types.Scene) -> Shot:
        """Takes what the scene's folder holds."""
        shot = cls._replace(scene)
        shot.status["state"] = "preparing"
        shot._live.open()
        return shot

    @classmethod
    def _replace(cls, scene: bpy.types.Scene) -> Shot:
        before = of(scene)
        if before is not None:
            before.close()
        shot = _shots[scene.session_uid] = cls(scene, options_of(scene))
        return shot

    def _export(self, scene: bpy.types.Scene) -> None:
        self._exported(scene, load_scene(scene, ExportOptions()), None)

    def _exported(self, scene: bpy.types.Scene, exported: Any, error: BaseException | None) -> None:
        if not self.is_open:
            return
        if error is not None:
            self.status |= {"state": "failed", "error": str(error)}
            return
        self.warnings = list(exported.warnings)
        settings = trace_settings(scene, self.warnings.append)
        settings |= {"samples": self.options.samples, "threads": self.options.threads}
        self._live.bake(exported, settings, train_seconds=self.options.train_seconds)

    @property
    def is_open(self) -> bool:
        """Whether it was not closed."""
        return _shots.get(self.scene_uid) is self

    @property
    def is_working(self) -> bool:
        """Whether something is being baked or trained."""
        return self.status["state"] in WORKING

    @property
    def is_busy(self) -> bool:
        """Whether a newer status or picture is to be expected."""
        if self.is_working or self.status["state"] in {"empty", "failed"}:
            return self.is_working
        shown = self.status["shown"] or {"request": 0, "settled": False}
        return shown["request"] < self._request_number or not shown["settled"]

    def relight(self, lights: list[dict], mix: dict, interactive: bool) -> bool:
        """Asks for a picture; the newest request wins. `lights` as `SceneLights` describes them, `mix` as
        `core.rows.mix` does. False if that is what was asked for before."""
        request = json.dumps({"lights": lights, **mix, "interactive": interactive, "with": "auto"})
        if request == self.request:
            return False
        self.ask(request)
        return True

    def ask(self, request: str) -> int:
        """Asks for the picture of a request as it was kept; its number."""
        self.request = request
        self._request_number = self._live.relight(request)
        return self._request_number

    def poll(self) -> bool:
        """Takes the newest picture and status; whether there was anything new."""
        text = self._live.status()
        frame = self._live.frame(self.frame.serial if self.frame else 0)
        if text == self._status_text and frame is None:
            return False
        self._status_text, self.status = text, json.loads(text)
        self.frame = frame or self.frame
        return True

    def pause(self, paused: bool) -> None:
        """Lets baking and training stand still; relighting goes on."""
        self._live.pause(paused)

    def cancel(self) -> None:
        """Ends baking and training; what is there stays, relighting goes on."""
        self._live.cancel()

    def close(self) -> None:
        """Ends everything, without waiting. The folder stays whole."""
        if self.is_open:
            del _shots[self.scene_uid]
        self._live.close()
        self.frame = None


def _view_layer(scene: bpy.types.Scene) -> str:
    return bpy.context.view_layer.name if bpy.context.scene == scene else scene.view_layers[0].name


def of(scene: bpy.types.Scene) -> Shot | None:
    """The open shot of a scene."""
    return _shots.get(scene.session_uid)


def all_open() -> list[Shot]:
    """All open shots."""
    return list(_shots.values())


def close_all() -> None:
    """Closes every shot: before another file is opened, and when the add-on is disabled."""
    for shot in all_open():
        shot.close()
