"""The Blender command line: `bake`, `export`, `farm` and `relight` read the open scene, others are the native ones."""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy

from . import light_commands, shot_commands
from .core import command_line
from .core.bake_folder import OTHER_WORLD, camera_of, clear, clear_paths, is_bake, size_of
from .core.progress import Pace, Reporter, clock
from .engine.native import native
from .engine.reading.scene import load_scene
from .engine.shot import baked_state, record
from .engine.shot.farm import frame_name
from .engine.workers import image_colors, pictures, view_worker
from .engine.world import world_render, worlds
from .export import ExportError, ExportOptions, trace_settings, write_view_table
from .export.view_layer import force_layer, free_layers

STOPPED = 130
"""Exit code of a run that was asked to stop: 128 + SIGINT, as shells report it."""
OF_SCENE = ("scene", "camera", "frame", "resolution", "resolution_percentage")
"""Options that say how the open scene is looked at."""

OF_BAKE = ("samples", "bounces", "tile", "seed", "towards")
"""Options that replace the scene's settings of a bake."""


class Stopped(BaseException):  # noqa: N818 -- like KeyboardInterrupt, it is no error
    """SIGTERM was received."""


def run(arguments: list[str]) -> int:
    """Runs a command with the open file and returns the exit code."""
    reporter = Reporter(quiet="--quiet" in arguments, as_json="--json" in arguments)
    try:
        return _run(arguments, reporter)
    finally:
        free_layers()
        reporter.flush()


def _run(arguments: list[str], reporter: Reporter) -> int:
    try:
        if command_line.is_forwarded(arguments):
            return native().run_command_line(arguments)
        options, rest = command_line.parse(arguments)
        with _stopped_by_sigterm():
            return COMMANDS[options.command](options, rest, reporter)
    except command_line.UsageError as error:
        reporter.error(str(error))
        return 2
    except SystemExit:  # after --help
        return 0
    except (KeyboardInterrupt, Stopped):
        reporter.error("stopped; start it again with --resume to go on")
        return STOPPED
    except Exception as error:
        reporter.error(_words(error))
        return 1


def _words(error: Exception) -> str:
    """One line that says why a command failed."""
    if isinstance(error, OSError) and error.filename is not None:
        return f"cannot use {error.filename}: {error.strerror}"
    if isinstance(error, (OSError, ValueError, RuntimeError)) or type(error).__module__.startswith(__package__):
        return " ".join(str(error).split()) or repr(error)
    return f"internal error, please report it: {error!r}"


@contextmanager
def _stopped_by_sigterm() -> Iterator[None]:
    def stop(_signal: int, _frame: Any) -> None:
        raise Stopped

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def bake(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Traces the open scene into a folder, with its lights and its view transform beside the paths; or shots of its
    list, each into its own."""
    if options.shots is not None or options.folders is not None:
        return shot_commands.bake_shots(options, reporter, _open_scene, _bake, _words)
    if options.out is None:
        raise command_line.UsageError("name a bake folder with --out, or shots with --shots")
    scene = _open_scene(options, reporter)
    report = _bake(scene, options, reporter)
    reporter.result(
        report,
        f"{options.out}: {report['width']} x {report['height']} pixels, {report['samples']} samples, "
        f"{report['segments'] / 1e6:.1f} M segments, {report['bytes'] / 2**20:.0f} MiB in {clock(report['seconds'])}",
    )
    return 0


def _bake(
    scene: bpy.types.Scene, options: argparse.Namespace, reporter: Reporter, load: shot_commands.LoadScene = load_scene
) -> dict[str, Any]:
    """Traces a scene into the folder of the options; the native module's report."""
    folder = Path(options.out)
    exported = load(scene, _export_options(options))
    settings = _settings(scene, options, reporter)
    if use := native().folder_in_use(folder):
        raise ExportError(use)
    if options.replace and is_bake(folder):
        _make_room(folder, exported.difference(folder, json.dumps(settings)))
    report = native().bake(exported, folder, settings, resume=options.resume).wait(reporter.progress, reporter.warning)
    camera = scene.objects.get(options.camera or "")
    record.of(scene, exported.world_map, camera, exported.resolution).write(folder)
    write_view_table(scene, folder / "view.png")
    return report


def export(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Writes the open scene, with its render settings and its view, into a file that is traced without Blender."""
    file = Path(options.out)
    command_line.check_out(file, ".scene", "scenes are written as scene files")
    scene = _open_scene(options, reporter)
    exported = _write_scene(scene, options, file, reporter.warning)
    for warning in exported.warnings:
        reporter.warning(warning)
    (width, height), size = exported.resolution, file.stat().st_size
    text = f"{file}: {width} x {height} pixels, {size / 2**20:.1f} MiB; trace it with: relume trace {file} --out FOLDER"
    reporter.result({"width": width, "height": height, "bytes": size}, text)
    return 0


def _write_scene(scene: bpy.types.Scene, options: argparse.Namespace, file: Path, warn: Callable[[str], None]) -> Any:
    """Writes a scene as it is now into a scene file; returns it."""
    exported = load_scene(scene, _export_options(options))
    settings = trace_settings(scene, warn)
    with tempfile.TemporaryDirectory(prefix="relume-") as folder:
        view = Path(folder) / "view.png"
        write_view_table(scene, view)
        exported.write(file, json.dumps(settings), view=view.read_bytes() if view.exists() else None)
    return exported


def farm(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Writes the job of a farm: a bake folder without paths for each frame of the open scene, and the plan."""
    out, scene = Path(options.out), _open_scene(options, reporter)
    frames = options.frames or [scene.frame_current]
    told: set[str] = set()

    def warn(words: str) -> None:
        if words not in told:  # Most are of every frame.
            told.add(words)
            reporter.warning(words)

    out.mkdir(parents=True, exist_ok=True)
    records, camera = {}, scene.objects.get(options.camera or "")
    with tempfile.TemporaryDirectory(prefix=".relume-", dir=out) as folder:
        files = [Path(folder) / f"{frame_name(frame)}.scene" for frame in frames]
        for number, (frame, file) in enumerate(zip(frames, files, strict=True)):
            stage = {"stage": "prepare", "done": number, "total": len(frames), "remaining_s": None}
            reporter.progress(stage | {"message": f"frame {frame}"})
            if frame != scene.frame_current:
                scene.frame_set(frame)
            exported = _write_scene(scene, options, file, warn)
            records[file.stem] = record.of(scene, exported.world_map, camera, exported.resolution)
        words = [*map(str, files), "--out", str(out), "--parts", str(options.parts)]
        words += [f"--emit={kind}" for kind in options.emit]
        words += [f"--{name}={getattr(options, name)}" for name in OF_BAKE if getattr(options, name) is not None]
        planned = native().start("plan", *words).wait(reporter.progress, warn)
    for name, taken in records.items():
        taken.write(out / name)
    reporter.result(planned, f"{out}: {len(frames)} bakes, {planned['parts']} parts; bring home: relume collect {out}")
    return 0


def _make_room(folder: Path, difference: str | None) -> None:
    """Removes what a folder holds of another bake, as far as it is of no use for the one that is asked for."""
    if difference == OTHER_WORLD:
        clear_paths(folder)
    elif difference is not None:
        clear(folder)


def _settings(scene: bpy.types.Scene, options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    """The scene's settings with what the options override."""
    settings = trace_settings(scene, reporter.warning)
    for name in ("samples", "seed"):
        if getattr(options, name) is not None:
            settings[name] = getattr(options, name)
    if options.bounces is not None:
        bounces = settings.setdefault("paths", {}).setdefault("bounces", {})
        bounces |= dict.fromkeys(("total", "diffuse", "glossy", "transmission"), options.bounces)
    if options.towards:
        settings["towards"] = _light_set(Path(options.towards))
    return settings | {"tile_size": options.tile, "threads": options.threads}


def _light_set(file: Path) -> list[dict[str, Any]]:
    """The lights of a light set that the native command line wrote."""
    try:
        return json.loads(file.read_text(encoding="utf-8"))["lights"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ExportError(f"{file} cannot be read as a light set: {error}") from error


def relight(options: argparse.Namespace, rest: list[str], reporter: Reporter) -> int:
    """Relights a bake by the open scene's present lights, or by a light set."""
    command_line.check_out(Path(options.out), ".exr", "pictures are written as a multi-layer EXR, with a PNG beside it")
    if not Path(options.bake).is_dir():
        raise ExportError(f"there is no bake folder {options.bake}; make it with the command bake")
    if options.lights:
        if given := [f"--{name.replace('_', '-')}" for name in OF_SCENE if getattr(options, name) is not None]:
            raise command_line.UsageError(
                f"{', '.join(given)}: the lights of the open scene are meant by that; leave it out beside --lights"
            )
        return _relight(options, rest, options.lights, reporter)
    exported = _scene_of_bake(options, rest, reporter)
    with tempfile.TemporaryDirectory(prefix="relume-") as folder:
        lights = Path(folder) / "scene.json"
        lights.write_text(exported.lights())
        return _relight(options, rest, str(lights), reporter)


def _relight(options: argparse.Namespace, rest: list[str], lights: str, reporter: Reporter) -> int:
    machine = [f"--threads={options.threads}", f"--device={options.device}"]
    job = native().start("relight", options.bake, "--out", options.out, *rest, *machine, "--lights", lights)
    written = job.wait(reporter.progress, reporter.warning)
    by_proxy = sum(light["maker"] == "proxy" for light in written["lights"])
    text = f"{written['exr']} and {written['png']}: {len(written['lights'])} lights, {by_proxy} of them by proxy"
    reporter.result(written, text)
    return 0


def _pixels(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]} pixels"


def _scene_of_bake(options: argparse.Namespace, rest: list[str], reporter: Reporter) -> Any:
    """The open scene as it is, for its lights; says what else has changed since the bake."""
    folder, scene = Path(options.bake), _open_scene(options, reporter)
    if is_bake(folder) and options.camera not in {None, camera_of(folder)}:
        raise ExportError(
            f"{folder} is a bake of camera '{camera_of(folder)}'; leave --camera out, or bake camera '{options.camera}'"
        )
    exported = load_scene(scene, _export_options(options))
    size = size_of(folder)
    is_asked_for = options.resolution is not None or options.resolution_percentage is not None
    if size is not None and is_asked_for and size != exported.resolution:
        asked = _pixels(exported.resolution)
        raise ExportError(f"{folder} is a bake of {_pixels(size)}, not {asked}; leave the size out, or bake again")
    for warning in exported.warnings:
        reporter.warning(warning)
    has_own_world = any(word.startswith(("--world", "--environment")) for word in rest)
    if words := baked_state.difference(scene, exported, folder, options.camera, has_own_world):
        reporter.warning(words)
    return exported


def export_lights(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Writes the lights of the open scene for other programs."""
    return light_commands.export_lights(options, reporter, _open_scene)


def import_lights(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Makes a look of the lights of another program."""
    return light_commands.import_lights(options, reporter)


def verify(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Renders the open scene with Cycles and compares it with a picture."""
    from .engine.cycles import reference as cycles_reference

    pace = Pace()

    def on_progress(done: int, total: int) -> None:
        remaining_s = pace.remaining(done, total)
        reporter.progress({"stage": "render", "done": done, "total": total, "remaining_s": remaining_s})

    found = cycles_reference.verify(Path(options.folder), on_progress)
    text = f"error {100 * found['error']:.1f} %, noise {100 * found['noise']:.1f} %, PSNR {found['psnr']:.1f} dB"
    reporter.result(found, text)
    return 0


def read_picture(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Reads a target or a mask as the light that it shows."""
    words, is_doubtful = pictures.read(Path(options.folder))
    reporter.result({"words": words, "is_doubtful": is_doubtful}, words)
    return 0


def color_view(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Makes the table of a view, or the file of one."""
    view_worker.color(Path(options.folder))
    reporter.result({}, "coloured")
    return 0


def convert_image(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Makes an image scene-linear."""
    image_colors.convert(Path(options.folder))
    reporter.result({}, "converted")
    return 0


def render_world(options: argparse.Namespace, _rest: list[str], reporter: Reporter) -> int:
    """Renders a world with Cycles over all directions."""
    world_render.render(Path(options.folder))
    reporter.result({}, "rendered")
    return 0


def _open_scene(options: argparse.Namespace, reporter: Reporter) -> bpy.types.Scene:
    _check_that_the_file_was_opened()
    for library in bpy.data.libraries:
        if not library.packed_file and not Path(bpy.path.abspath(library.filepath)).exists():
            reporter.warning(f"library '{library.filepath}' is missing: nothing that is linked from it is there")
    if options.scene is not None:
        _show(options.scene)
    scene = bpy.context.scene
    if options.frame is not None:
        scene.frame_set(options.frame)
    _check_camera(scene, getattr(options, "camera", None))
    layer = getattr(options, "layer", None) or ""
    if layer and layer not in scene.view_layers:
        raise ExportError(f"scene '{scene.name}' has no view layer '{layer}'; it has {_all_of(scene.view_layers)}")
    force_layer(scene, layer)
    return scene


def _show(name: str) -> None:
    """Makes a scene that of the window: only that one is evaluated."""
    scene = bpy.data.scenes.get(name)
    if scene is None:
        raise ExportError(f"the file has no scene '{name}'; it has {_all_of(bpy.data.scenes)}")
    bpy.context.window.scene = scene


def _all_of(blocks: Iterable[bpy.types.ID]) -> str:
    return ", ".join(f"'{block.name}'" for block in blocks) or "none"


def _check_camera(scene: bpy.types.Scene, name: str | None) -> None:
    cameras = [obj for obj in scene.objects if obj.type == "CAMERA"]
    if name is not None and name not in {camera.name for camera in cameras}:
        raise ExportError(f"scene '{scene.name}' has no camera '{name}'; it has {_all_of(cameras)}")


def _check_that_the_file_was_opened() -> None:
    """Blender goes on with its default scene where it could not open the file (seen in 5.2, with `--command`)."""
    end = next((i for i, word in enumerate(sys.argv) if word in {"-c", "--command", "--"}), 0)
    named = [word for word in sys.argv[1:end] if re.search(r"\.blend\d*$", word, re.IGNORECASE)]
    if named and not bpy.data.filepath:
        raise ExportError(f"Blender could not open {named[0]}; check the path and the messages above")


def _export_options(options: argparse.Namespace) -> ExportOptions:
    return ExportOptions(
        camera=options.camera,
        resolution_percentage=options.resolution_percentage,
        resolution=options.resolution,
    )


COMMANDS = {
    "bake": bake,
    "export": export,
    "farm": farm,
    "relight": relight,
    "export-lights": export_lights,
    "import-lights": import_lights,
    "verify": verify,
    pictures.COMMAND: read_picture,
    image_colors.COMMAND: convert_image,
    worlds.COMMAND: render_world,
    view_worker.COMMAND: color_view,
}


def main(arguments: list[str]) -> int:
    """Calls `run`, then flushes the standard streams, for callers that only see those."""
    try:
        return run(arguments)
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
