"""Relume's command line for farms that start Blender with factory settings, and for the `bpy` module:

    blender -b shot.blend -P relume_bake.py -- bake --out FOLDER
    python relume_bake.py shot.blend -- bake --out FOLDER

The script finds the add-on beside itself, so the extension need not be enabled.
"""

import importlib.util
import os
import re
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import bpy

PACKAGE = "relume_addon"


def load_addon():
    """The add-on as a package of its own name, whatever its folder is called."""
    here = Path(__file__).resolve().parent
    folder = here / "addon" if (here / "addon").is_dir() else here
    spec = importlib.util.spec_from_file_location(
        PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = importlib.util.module_from_spec(spec)
    sys.modules[PACKAGE] = module
    spec.loader.exec_module(module)


@contextmanager
def native_module():
    """Makes `import relume` possible. With factory settings Blender does not look where it unpacked the extension's
    wheel, and it unpacks that only once the extension is enabled: then this does, for as long as the command runs."""
    here = Path(__file__).resolve().parent
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    unpacked = here.parents[1] / ".local" / "lib" / python / "site-packages"
    wheels = list((here / "wheels").glob("relume-*.whl"))
    with ExitStack() as stack:
        if importlib.util.find_spec("relume") is None:
            if not (unpacked / "relume").is_dir() and wheels:
                # Windows cannot remove a library in use.
                folder = TemporaryDirectory(prefix="relume-", ignore_cleanup_errors=True)
                unpacked = Path(stack.enter_context(folder))
                ZipFile(wheels[0]).extractall(unpacked)
            sys.path.append(str(unpacked))
        yield


def arguments():
    """Words of the command line that follow `--`."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    words = [] if bpy.app.binary_path else [word for word in sys.argv[1:] if not word.endswith(".blend")]
    if words and not words[0].startswith("-"):
        sys.exit(f"Error: the command comes after --: python relume_bake.py shot.blend -- {' '.join(words)}")
    return ["--help"]


def open_file():
    """Opens the file named before `--`, where Blender has not done so itself."""
    own = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    files = sys.argv[1:own]
    if bpy.app.binary_path or not files:
        return
    if len(files) > 1:
        sys.exit(f"Error: name one .blend file before --, not {len(files)}: {' '.join(files)}")
    if reason := why_not_opened(Path(files[0]).absolute()):
        sys.exit(f"Error: {files[0]} cannot be opened: {reason}")


def why_not_opened(file):
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


def written_by_newer(file):
    """Says which Blender wrote a file, if that is newer than this one; empty where that cannot be told."""
    with file.open("rb") as stream:
        found = re.search(rb"BLENDER.{1,5}v0?(\d)(\d\d)", stream.read(64))
    version = tuple(map(int, found.groups())) if found else (0, 0)
    newer = "Blender {}.{} wrote it, and this is {}.{}; use that one".format(*version, *bpy.app.version)
    return newer if version > bpy.app.version[:2] else ""


def main():
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


def run(asked):
    """Runs a command line of the add-on, and returns its exit code."""
    if "cycles" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="cycles")
    load_addon()
    from relume_addon.commands import main as run_command
    from relume_addon.engine.workers.process import end_with_owner

    end_with_owner()
    with native_module():
        return run_command(asked)


if __name__ == "__main__":
    main()
