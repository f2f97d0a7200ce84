"""The command line of a Blender that was started for it, or of the `bpy` module: `... shot.blend -- bake --out X`."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import bpy


def arguments() -> list[str]:
    """Words of the command line that follow `--`."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    words = [] if bpy.app.binary_path else [word for word in sys.argv[1:] if not word.endswith(".blend")]
    if words and not words[0].startswith("-"):
        sys.exit(f"Error: the command comes after --: python relume_bake.py shot.blend -- {' '.join(words)}")
    return ["--help"]


def open_file() -> None:
    """Opens the file named before `--`, where Blender has not done so itself."""
    own = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    files = sys.argv[1:own]
    if bpy.app.binary_path or not files:
        return
    if len(files) > 1:
        sys.exit(f"Error: name one .blend file before --, not {len(files)}: {' '.join(files)}")
    if reason := why_not_opened(Path(files[0]).absolute()):
        sys.exit(f"Error: {files[0]} cannot be opened: {reason}")


def why_not_opened(file: Path) -> str:
    """Opens a file; the reason in a few words if that cannot be done."""
    if file.is_dir():
        return "it is a folder; name a .blend file"
    if not file.exists():
        return "there is no file of this name"
    if not os.access(file, os.R_OK):
        return "you have no right to read it"
    if file.stat().st_size == 0:
        return "it is empty; restore it from a copy"
    try:
        bpy.ops.wm.open_mainfile(filepath=str(file))
    except RuntimeError as error:
        said = re.sub(
            r"""(Error: |Loading ".*" failed: |Failed to read blend file '.*'[:,] )""", "", str(error).strip()
        )
        if not bpy.data.filepath:
            return written_by_newer(file) or f"{said.splitlines()[-1]}; restore it from a copy"
        print(f"Warning: {said}", file=sys.stderr)  # What it links to is missing, for example.
    return ""


def written_by_newer(file: Path) -> str:
    """Says which Blender wrote a file, if that is newer than this one; empty where that cannot be told."""
    with file.open("rb") as stream:
        found = re.search(rb"BLENDER.{1,5}v0?(\d)(\d\d)", stream.read(64))
    version = tuple(map(int, found.groups())) if found else (0, 0)
    newer = "Blender {}.{} wrote it, and this is {}.{}; use that one".format(*version, *bpy.app.version)
    return newer if version > bpy.app.version[:2] else ""


def main() -> None:
    """Opens, runs, and leaves without Blender's own exit, which can crash or hang before 5.0."""
    asked = arguments()
    open_file()
    try:
        code = run(asked)
    except Exception as error:
        print(f"Error: Relume could not be started: {error!r}", file=sys.stderr)
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def run(asked: list[str]) -> int:
    """Runs a command line of the add-on, and returns its exit code."""
    if "cycles" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="cycles")
    from .commands import main as run_command
    from .engine.workers.process import end_with_owner

    end_with_owner()
    return run_command(asked)
