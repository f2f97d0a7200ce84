"""Final renders by Relume: the bake of the scene if there is one, otherwise a new one, relit by the present lights and
the rows' mix, in passes."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.bake_folder import is_bake
from ...core.diff import gain_between
from ...core.pass_names import ALBEDO, CATCHER, COMBINED, DEPTH, LOBES, LONGEST, NORMAL, STATIC, WORLD, light_passes
from ...core.progress import progress_line
from ...core.rows import NEUTRAL
from ...core.shots import AUTOMATIC
from ...core.words import grouped, listed
from ...export import ExportOptions, trace_settings
from ...export.camera import film_border, film_size, why_no_picture
from ...export.current_shot import current_entry
from ...export.stop import ExportCancelled
from ...export.view_layer import entry_of_layer
from ..native import native
from ..reading.scene import scene_of_depsgraph
from ..shot import open_shots
from ..shot import shot as shots
from ..shot.checks import folders_in_use
from ..shot.options import Options, options_of, remembered_bake
from ..workers.process import private_folder
from .data_passes import MATTES, DataPassSettings, assets_of, matte_fields
from .unwritten_passes import unwritten_passes

ENGINE = "RELUME"
"""Identifier for `bpy.types.RenderSettings.engine`."""
POLL_SECONDS = 0.05
NOTHING_HIT = 1e10
"""Cycles' depth where no surface is."""
ALBEDO_HERE = "DiffCol" if bpy.app.version < (5, 0, 0) else ALBEDO
"""This Blender's name of that pass."""
BAKE_SHARE = 0.9
"""Share of the progress bar for the bake, where one has to be made."""


@dataclass(frozen=True)
class PassSettings:
    """Passes that a render has besides Combined."""

    longest: int = LONGEST
    """Bytes of the name of a light's pass."""
    lights: bool = True
    """One for each light, and `static` and `world`."""
    lobes: bool = False
    """Those of each light by lobes, too."""
    depth: bool = False
    normal: bool = False
    albedo: bool = False
    data: DataPassSettings = DataPassSettings()
    shadow_catcher: bool = False
    """Pass of what shadow catchers show; Combined is without it then, as with Cycles."""

    def declare(self, lights: list[str]) -> list[tuple[str, int, str, str]]:
        """Name, channels, their letters and Blender's type of each pass."""
        channels = [(COMBINED, 4, "RGBA", "COLOR")]
        if self.lights:
            names = [*self.named(lights), STATIC, WORLD]
            channels += [(name, 3, "RGB", "COLOR") for name in names]
        channels += [(DEPTH, 1, "Z", "VALUE")] * self.depth
        channels += [(NORMAL, 3, "XYZ", "VECTOR")] * self.normal
        channels += [(ALBEDO_HERE, 3, "RGB", "COLOR")] * self.albedo
        channels += [(CATCHER, 3, "RGB", "COLOR")] * self.shadow_catcher
        return channels + self.data.declare()

    def named(self, lights: Iterable[str]) -> dict[str, tuple[str, str]]:
        """Light and part of each pass of some lights, by its name."""
        lights = list(lights)
        parts = (COMBINED, *LOBES) if self.lobes else (COMBINED,)
        return {
            name: (light, part) for part in parts for light, name in light_passes(lights, self.longest, part).items()
        }


_stopping = False


def stop_all(stop: bool = True) -> None:
    """Ends all renders soon, and those that begin until it is called with `stop` off."""
    global _stopping
    _stopping = stop


MixOf = Callable[[bpy.types.Scene, list[str], str], dict[str, Any]]
"""Gains of the named lights, of world and static light, as `core.rows.mix` gives them, in the shot of a key."""
PassesOf = Callable[[bpy.types.Scene, bpy.types.ViewLayer], PassSettings]


def render(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, mix_of: MixOf, passes_of: PassesOf) -> None:
    """Body of `RenderEngine.render`. What goes wrong is reported: an exception would hang Blender before 5.0."""
    try:
        _FinalRender(engine, depsgraph, mix_of, passes_of).run()
    except ExportCancelled:
        # Without an error Blender would write the empty picture, and crash where Freestyle draws lines into it.
        if _stopping:
            with suppress(ReferenceError):
                engine.report({"ERROR"}, "Relume: disabled while it rendered; there is no picture")
    except BaseException as error:
        # Blender removes an engine that is disabled while it renders.
        with suppress(ReferenceError):
            engine.report({"ERROR"}, f"Relume: {error or repr(error)}")


class _FinalRender:
    def __init__(
        self,
        engine: bpy.types.RenderEngine,
        depsgraph: bpy.types.Depsgraph,
        mix_of: MixOf,
        passes_of: PassesOf,
    ):
        self.engine, self.depsgraph, self.mix_of = engine, depsgraph, mix_of
        self.scene = depsgraph.scene
        self.entry = entry_of_layer(self.scene, depsgraph.view_layer.name)
        """The listed shot of the layer."""
        self.options: Options = options_of(self.scene, self.entry)
        self.passes = passes_of(self.scene, depsgraph.view_layer)
        self.mix: dict[str, Any] = {}
        self.said: set[str] = set()
        """Warnings that were reported."""

    def run(self) -> None:
        if words := why_no_picture(self.scene):
            raise RuntimeError(words)
        self._say("Reading the scene", 0.0)
        exported = self._exported()
        for text in grouped(tuple(exported.warnings)):
            self._warn(text)
        if words := unwritten_passes(self.scene, self.depsgraph.view_layer):
            self._warn(words)
        lights = self._mixed(json.loads(exported.lights()))
        with self._baked(exported, lights) as relighter:
            picture = self._relit(relighter, lights, exported.world_color)
            data = self._data_layers(exported, relighter) if self.passes.data else {}
        self._write(picture, data)

    def _exported(self) -> Any:
        options = ExportOptions(resolution=film_size(self.scene.render))
        return scene_of_depsgraph(self.engine, self.depsgraph, options, self._is_stopped)

    @contextmanager
    def _baked(self, exported: Any, lights: list[dict[str, Any]]) -> Iterator[Any]:
        """A relighter of the scene: of its own bake where that fits or is free, else of one for this picture only."""
        folder = self._folder()
        if folder is None:
            with private_folder() as private:
                self._bake(exported, Path(private))
                yield self._open(Path(private), exported)
            return
        info = native().info(folder) if is_bake(folder) else {}
        is_same = bool(info) and self._is_of(info, exported, folder)
        relighter = self._open(folder, exported) if is_same and self._is_whole(info) else None
        misses = relighter is not None and self._misses(relighter, lights)
        with ExitStack() as temporary:
            if relighter is None or misses:
                if not (is_same or _is_free(folder)) or self._is_being_baked(folder) or misses:
                    folder = Path(temporary.enter_context(private_folder()))
                self._bake(exported, folder)
                relighter = self._open(folder, exported)
            yield relighter

    def _is_of(self, info: dict[str, Any], exported: Any, folder: Path) -> bool:
        """True if the bake is of this scene with its settings. Any seed will do, and any world if each pixel has a
        sample."""
        settings = self._settings(lambda _: None) | {"seed": info["manifest"]["seed"], "samples": 1}
        return exported.difference(folder, json.dumps(settings)) is None

    def _open(self, folder: Path, exported: Any) -> Any:
        """A relighter under the world of the scene."""
        machine = {"device": self.options.device, "gpu_memory": self.options.gpu_memory}
        relighter = native().Relighter(folder, world_of=exported, shots=open_shots.natives(), **machine)
        for words in relighter.damaged:
            self.engine.report({"WARNING"}, f"Relume: {words}")
        return relighter

    def _folder(self) -> Path | None:
        """The bake that the panel shows or would show of the layer's shot; None where the list has shots of other
        layers alone."""
        if self.entry is None and current_entry(self.scene) is not None:
            return None
        key = self.options.shot
        shot = shots.of(self.scene) if self.entry is None else open_shots.by_key(self.scene, key)
        if shot is not None:
            return shot.folder
        remembered = remembered_bake(self.scene, key)
        return remembered if remembered and is_bake(remembered) else self.options.folder

    def _is_whole(self, info: dict[str, Any]) -> bool:
        """True if the bake has at least one sample of each pixel. An artist who waits for more sees those that are
        there."""
        there, wanted = info["shards"]
        whole = there * len(info["manifest"]["passes"]) >= wanted
        if whole and there < wanted:
            self.engine.report({"WARNING"}, f"Relume: the bake is unfinished, {100 * there // wanted} % of it is used")
        return whole

    def _misses(self, relighter: Any, lights: list[dict[str, Any]]) -> bool:
        """True if lights were moved to where the bake's paths do not look: their light would be missing."""
        names = relighter.rarely_met(json.dumps(lights))
        if names:
            words = f"few paths of the bake meet {listed(names)} now: new ones are traced for this picture"
            self.engine.report({"INFO"}, f"Relume: {words}")
        return bool(names)

    def _is_being_baked(self, folder: Path) -> bool:
        """True if a bake writes into the folder, from this Blender or another process."""
        is_shown = any(shot.folder == folder and shot.is_working for shot in open_shots.all_of(self.scene))
        return is_shown or folder in folders_in_use(self.scene)

    def _bake(self, exported: Any, folder: Path) -> None:
        job = native().bake(exported, folder, self._settings(self._warn), resume=True)
        self._wait(job, 0.0, BAKE_SHARE, self._warn)

    def _warn(self, text: str) -> None:
        """Tells the artist something, once."""
        if text not in self.said:
            self.said.add(text)
            self.engine.report({"WARNING"}, f"Relume: {text}")

    def _settings(self, warn: Callable[[str], None]) -> dict[str, Any]:
        own = {"samples": self.options.samples, "threads": self.options.threads}
        return trace_settings(self.scene, warn) | own

    def _mixed(self, lights: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """The lights with the gains of the rows."""
        key = AUTOMATIC if self.entry is None else self.entry.key
        self.mix = self.mix_of(self.scene, [light["name"] for light in lights], key)
        gains = self.mix["gains"]
        return [
            light | {"radiance": [a * b for a, b in zip(light["radiance"], gains[light["name"]], strict=True)]}
            for light in lights
        ]

    def _relit(self, relighter: Any, lights: list[dict[str, Any]], world_color: list[float]) -> dict[str, Any]:
        """Layers of the picture, each with its gain; a silent light is black and costs nothing."""
        request = json.dumps([light for light in lights if any(light["radiance"])])
        lobes = self.passes.lights and self.passes.lobes
        self._wait(native().Job(relighter.prepare(request, lobes=lobes)), BAKE_SHARE, 1.0, lambda _: None)
        # A bake that was begun under another strength or tint of the world serves as well.
        since = gain_between(relighter.world_color, world_color) or NEUTRAL
        world = [a * b for a, b in zip(self.mix["world"], since, strict=True)]
        apart = self.passes.shadow_catcher
        mix = {"static_light": self.mix["static"], "world": world, "catcher_apart": apart}
        picture = relighter.relight(request, **mix, lobes=lobes)
        silent = np.zeros_like(picture["static"])
        names = [light["name"] for light in lights]
        picture["lights"] = {name: picture["lights"].get(name, silent) for name in names}
        dark = dict.fromkeys(LOBES, silent)
        picture["lobes"] = {name: picture["lobes"].get(name, dark) if lobes else {} for name in names}
        return picture

    def _data_layers(self, exported: Any, relighter: Any) -> dict[str, np.ndarray]:
        """Data passes, with what the file tells of them."""
        wanted, settings = self.passes.data, self._settings(lambda _: None)
        assets = assets_of(self.depsgraph)
        frames = self._next_frames() if wanted.vector else None
        traced = wanted.trace(exported, json.dumps(settings), self.options.samples, assets, frames, relighter)
        self._wait(native().Job(traced.job), 1.0, 1.0, self._warn)
        objects, materials = traced.names()
        names = {
            "objects": objects,
            "materials": materials,
            "assets": {assets.get(name, name) for name in objects},
        }
        for matte in wanted.mattes:
            fields = matte_fields(self.depsgraph.view_layer_eval.name, matte, sorted(names[MATTES[matte]]))
            for field, value in fields.items():
                # Those of `begin_result` would be lost.
                self.engine.get_result().stamp_data_add_field(field, value)
        return wanted.layers(traced.pictures())

    def _next_frames(self) -> tuple[Any, Any]:
        """The scene at the frame before and at the one after."""
        frame, part = self.scene.frame_current, self.scene.frame_subframe
        try:
            self.engine.frame_set(frame - 1, subframe=part)
            before = self._exported()
            self.engine.frame_set(frame + 1, subframe=part)
            return before, self._exported()
        finally:
            self.engine.frame_set(frame, subframe=part)

    def _wait(self, job: Any, start: float, end: float, warn: Callable[[str], None]) -> None:
        """Watches a job of the native module; Esc ends it."""
        try:
            while not job.done:
                self._check()
                report = job.progress()
                if report is not None:
                    share = report["done"] / max(report["total"], 1)
                    self._say(progress_line(report), start + (end - start) * share)
                time.sleep(POLL_SECONDS)
        except BaseException:
            job.cancel()
            with suppress(native().RelumeError):
                job.result()
            raise
        for text in grouped(tuple(job.warnings())):
            warn(text)
        job.result()

    def _check(self) -> None:
        if self._is_stopped():
            raise ExportCancelled("cancelled")

    def _is_stopped(self) -> bool:
        return _stopping or self.engine.test_break()

    def _say(self, text: str, progress: float) -> None:
        self.engine.update_stats("Relume", text)
        self.engine.update_progress(progress)

    def _write(self, picture: dict[str, Any], data: dict[str, np.ndarray]) -> None:
        """Hands the layers over, Blender's render border cut out of them."""
        layers = self._layers(picture) | data
        layer_name = self.depsgraph.view_layer_eval.name
        for name, channels, letters, _ in self.passes.declare(list(picture["lights"])):
            if name != COMBINED:
                self.engine.add_pass(name, channels, letters, layer=layer_name)
        x, y, width, height = film_border(self.scene.render)
        result = self.engine.begin_result(0, 0, width, height, layer=layer_name)
        try:
            for render_pass in result.layers[0].passes:
                image = layers.get(render_pass.name)
                if image is not None:
                    # Blender's first row is at the bottom.
                    part = image[::-1][y : y + height, x : x + width]
                    render_pass.rect.foreach_set(np.ascontiguousarray(part, np.float32).reshape(-1))
        finally:
            self.engine.end_result(result)

    def _layers(self, picture: dict[str, Any]) -> dict[str, np.ndarray]:
        passes = self.passes.named(picture["lights"]) if self.passes.lights else {}
        of_lights = {
            name: picture["lights"][light] if part == COMBINED else picture["lobes"][light][part]
            for name, (light, part) in passes.items()
        }
        return {
            COMBINED: np.concatenate([picture["combined"], picture["alpha"]], axis=-1),
            **of_lights,
            STATIC: picture["static"],
            WORLD: picture["world"],
            DEPTH: self._depth(picture["depth"]),
            NORMAL: picture["normal"],
            ALBEDO_HERE: picture["albedo"],
            **({CATCHER: picture["shadow_catcher"]} if "shadow_catcher" in picture else {}),
        }

    def _depth(self, distance: np.ndarray) -> np.ndarray:
        """Cycles' depth, along the view axis, from the distance along each pixel's ray."""
        camera = self.depsgraph.scene_eval.camera.data
        depth = distance
        if camera.type == "PERSP":
            frame = np.array(camera.view_frame(scene=self.depsgraph.scene_eval))
            (left, bottom, _), (right, top, z) = frame.min(axis=0), frame.max(axis=0)
            height, width = distance.shape[:2]
            x = left + (right - left) * (np.arange(width) + 0.5) / width
            y = top + (bottom - top) * (np.arange(height) + 0.5) / height
            depth = distance * (-z / np.sqrt(x**2 + y[:, None] ** 2 + z**2))[..., None]
        return np.where(distance > 0.0, depth, NOTHING_HIT)


def _is_free(folder: Path) -> bool:
    """True if a bake can be written into the folder without replacing anything."""
    return not folder.exists() or not any(folder.iterdir())
