"""Arguments of the Blender command line: `blender -b shot.blend --command relume bake --out FOLDER`."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import NoReturn

PROGRAM = "relume"
FORWARDED = {
    "plan": "prepare bakes of scene files that many machines trace",
    "work": "trace parts of a job",
    "collect": "check what the machines of a job have made",
    "train": "train a proxy on a bake",
    "gather": "sum lights over a bake, without a proxy",
    "optimise": "find lights that make a target picture",
    "info": "say what a bake folder, proxy, light set or scene file is",
    "validate": "check a bake folder, proxy, light set or scene file for damage",
}
"""Commands that need no scene: their arguments go to the native command line as they are."""

NATIVE_LIST = "--shots"
"""Option with which `relight` is the native command too: each bake of a list has its own scene."""


def is_forwarded(arguments: list[str]) -> bool:
    """True for a command line that needs no scene."""
    command, *rest = arguments or [""]
    return command in FORWARDED or (command == "relight" and any(word.split("=")[0] == NATIVE_LIST for word in rest))


class UsageError(Exception):
    """The arguments are wrong; the message says which, in one line."""


def check_out(file: Path, suffix: str, what: str) -> None:
    """Raises UsageError for a file that a command could not write in the end; `what` says what it writes."""
    if file.is_dir():
        raise UsageError(f"{file} is a folder; name a file in it, such as {file / 'shot'}{suffix}")
    if file.suffix.lower() != suffix:
        raise UsageError(f"cannot write {file}: {what}; let the name end in {suffix}")
    if not file.absolute().parent.is_dir():
        raise UsageError(f"cannot write {file}: its folder does not exist; make it first")


class _Parser(argparse.ArgumentParser):
    """Raises where argparse prints and exits."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Options of a command that reads the open scene, and what `relight` passes on to the native command line.

    Raises `UsageError`, or `SystemExit` after help was printed."""
    options, rest = parser().parse_known_args(arguments)
    if rest and options.command != "relight":
        raise UsageError(f"unknown arguments: {' '.join(rest)} (see {PROGRAM} {options.command} --help)")
    return options, rest


def parser() -> argparse.ArgumentParser:
    """Parser of the commands that read the open scene, and list of the others."""
    top = _Parser(prog=PROGRAM, description="Relights finished shots.")
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_bake(commands)
    _add_export(commands)
    _add_farm(commands)
    _add_relight(commands)
    _add_lights(commands)
    _add_verify(commands)
    _add_read_picture(commands)
    _add_render_world(commands)
    _add_convert_image(commands)
    _add_color_view(commands)
    for name, text in FORWARDED.items():
        commands.add_parser(name, help=f"{text} (see `{PROGRAM} {name} --help`)", add_help=False)
    return top


def _add_bake(commands: argparse._SubParsersAction) -> None:
    bake = commands.add_parser("bake", help="trace the paths of the open scene into a bake folder")
    bake.add_argument(
        "-o", "--out", metavar="FOLDER", help="bake folder to write; with --shots the folder of their folders"
    )
    bake.add_argument(
        "--shots", metavar="NAMES", help="shots of the scene's list: all, or names with commas between (A,B)"
    )
    # Shots of the list to be baked, each with its folder, as JSON: the panel gives it.
    bake.add_argument("--folders", help=argparse.SUPPRESS)
    _add_view(bake)
    bake.add_argument("--layer", metavar="NAME", help="view layer; default: the first one that Blender renders")
    _add_settings(bake)
    bake.add_argument("--resume", action="store_true", help="go on with an interrupted bake")
    bake.add_argument("--replace", action="store_true", help="remove a bake of another scene from the folder first")
    _add_run(bake)


def _add_export(commands: argparse._SubParsersAction) -> None:
    export = commands.add_parser("export", help="write the open scene into a file that is traced without Blender")
    export.add_argument("-o", "--out", required=True, metavar="FILE", help="scene file to write, for `relume trace`")
    _add_view(export)
    _add_output(export)


def _add_farm(commands: argparse._SubParsersAction) -> None:
    farm = commands.add_parser(
        "farm", help="write the job of a farm: bakes of frames of the open scene, cut into parts"
    )
    farm.add_argument("-o", "--out", required=True, metavar="FOLDER", help="job folder to write")
    _add_view(farm)
    farm.add_argument(
        "--frames", type=_frames, metavar="LIST", help="frames to bake, such as 1-10,15; default: the present one"
    )
    farm.add_argument("--parts", type=_positive, default=8, help="parts that the bake of each frame is cut into")
    farm.add_argument(
        "--emit",
        action="append",
        default=[],
        metavar="FARM",
        help="write a file for openjd, openjd-chunks, flamenco, slurm or make; may be given again",
    )
    _add_settings(farm)
    _add_output(farm)


def _add_relight(commands: argparse._SubParsersAction) -> None:
    relight = commands.add_parser(
        "relight",
        help="relight a bake by the lights of the open scene, into an EXR and a PNG",
        epilog="Further options go to the native command line, see its own help.",
    )
    relight.add_argument("bake", help="bake folder")
    relight.add_argument("-o", "--out", required=True, metavar="FILE", help="multi-layer EXR to write")
    relight.add_argument("--lights", metavar="FILE", help="light set (JSON); default: the lights of the open scene")
    _add_view(relight)
    _add_run(relight)


def _add_lights(commands: argparse._SubParsersAction) -> None:
    out = commands.add_parser("export-lights", help="write the lights of the open scene as UsdLux, for other programs")
    out.add_argument("-o", "--out", required=True, metavar="FILE", help="text file of OpenUSD to write: .usda or .usd")
    out.add_argument("--look", metavar="FILE", help="look (JSON) whose lights and rows are meant; default: as they are")
    out.add_argument("--suns-for-blender", action="store_true", help="write suns as Blender's own importer takes them")
    out.add_argument("--scene", metavar="NAME", help="scene of the file; default: that of its first window")
    out.add_argument("--frame", type=int, help="frame; default: the file's present one")
    _add_output(out)
    into = commands.add_parser("import-lights", help="make a look of the lights of a file of OpenUSD")
    into.add_argument("file", help="text file of OpenUSD")
    into.add_argument("-o", "--out", required=True, metavar="FILE", help="look to write (JSON)")
    _add_output(into)


def _add_verify(commands: argparse._SubParsersAction) -> None:
    verify = commands.add_parser("verify", help="compare a picture with a render by Cycles (used by the panel)")
    verify.add_argument("folder", help="folder with the job and the picture, for the results too")
    _add_output(verify)


def _add_read_picture(commands: argparse._SubParsersAction) -> None:
    read = commands.add_parser("read-picture", help="read a target or a mask for the solver (used by the panel)")
    read.add_argument("folder", help="folder with the job, for the result too")
    _add_output(read)


def _add_render_world(commands: argparse._SubParsersAction) -> None:
    render = commands.add_parser("render-world", help="render a world with Cycles over all directions (used by a bake)")
    render.add_argument("folder", help="folder with the job, for the result too")
    _add_output(render)


def _add_convert_image(commands: argparse._SubParsersAction) -> None:
    convert = commands.add_parser("convert-image", help="make an image scene-linear (used by a bake)")
    convert.add_argument("folder", help="folder with the job, for the result too")
    _add_output(convert)


def _add_color_view(commands: argparse._SubParsersAction) -> None:
    color = commands.add_parser("color-view", help="make the table of a view (used by the panel)")
    color.add_argument("folder", help="folder with the job, for the result too")
    _add_output(color)


def _add_view(command: argparse.ArgumentParser) -> None:
    command.add_argument("--scene", metavar="NAME", help="scene of the file; default: that of its first window")
    command.add_argument("--camera", metavar="NAME", help="camera object; default: the scene's camera")
    command.add_argument("--frame", type=int, help="frame; default: the file's present one")
    size = command.add_mutually_exclusive_group()
    size.add_argument(
        "--resolution-percentage", type=_positive, metavar="P", help="size in per cent; default: the scene's"
    )
    size.add_argument("--resolution", type=_size, metavar="WxH", help="size in pixels; default: the scene's")


def _add_settings(command: argparse.ArgumentParser) -> None:
    command.add_argument("--samples", type=_positive, help="paths per pixel; default: the scene's")
    command.add_argument("--bounces", type=_count, help="most bounces, in all and of each kind; default: the scene's")
    command.add_argument("--tile", type=_positive, default=64, help="edge of the image tiles in pixels")
    command.add_argument("--seed", type=_count, help="seed of all random numbers; default: the scene's")
    command.add_argument(
        "--towards", metavar="FILE", help="light set that paths look for besides, as optimise found it"
    )


def _add_run(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--device",
        default="auto",
        metavar="NAME",
        help="where to compute: auto, cpu, gpu, a part of a GPU's name or where it is plugged in (0000:01:00.0)",
    )
    command.add_argument("--threads", type=_count, default=0, help="worker threads; 0 for one a core")
    _add_output(command)


def _add_output(command: argparse.ArgumentParser) -> None:
    output = command.add_mutually_exclusive_group()
    output.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    output.add_argument("--json", action="store_true", help="print progress and results as JSON lines")


def _size(text: str) -> tuple[int, int]:
    width, x, height = text.lower().partition("x")
    if not (x and width.isdecimal() and height.isdecimal() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"'{text}' is no size; give width and height like 1920x1080")
    return int(width), int(height)


def _frames(text: str) -> list[int]:
    """Frames of a list of numbers and ranges, in order."""
    frames: set[int] = set()
    for part in text.split(","):
        found = re.fullmatch(r"\s*(-?\d{1,7})(?:-(-?\d{1,7}))?\s*", part)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if first > last:
            raise argparse.ArgumentTypeError(f"'{text}' names no frames; give numbers and ranges like 1-10,15")
        frames.update(range(first, last + 1))
    return sorted(frames)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' must be a whole number from 1 on")
    return int(text)


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"'{text}' must be a whole number from 0 on")
    return int(text)
