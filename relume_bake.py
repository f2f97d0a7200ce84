"""Relume's command line for farms that start Blender with factory settings, and for the `bpy` module:

    blender -b shot.blend -P relume_bake.py -- bake --out FOLDER
    python relume_bake.py shot.blend -- bake --out FOLDER

The script finds the add-on beside itself, so the extension need not be enabled.
"""

import importlib.util
import os
import sys
from pathlib import Path

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


def find_native_module():
    """With factory settings Blender may not look where it unpacked the extension's wheel; then this does."""
    if importlib.util.find_spec("relume") is not None:
        return
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    wheels = Path(__file__).resolve().parents[2] / ".local" / "lib" / python / "site-packages"
    if (wheels / "relume").is_dir():
        sys.path.append(str(wheels))


def arguments():
    """What follows `--`."""
    return sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else ["--help"]


def open_file():
    """Opens the file named before `--`, where Blender has not done so itself."""
    files = [argument for argument in sys.argv[1:] if argument.endswith(".blend")]
    own = sys.argv.index("--") if "--" in sys.argv else len(sys.argv)
    if bpy.app.binary_path or not files or sys.argv.index(files[0]) > own:
        return
    if not Path(files[0]).is_file():
        sys.exit(f"Error: there is no file {files[0]}")
    bpy.ops.wm.open_mainfile(filepath=os.path.abspath(files[0]))


def main():
    """Opens, runs, and leaves without Blender's own exit, which can crash or hang before 5.0."""
    open_file()
    if "cycles" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="cycles")
    find_native_module()
    load_addon()
    from relume_addon.engine.commands import main as run

    os._exit(run(arguments()))


if __name__ == "__main__":
    main()
