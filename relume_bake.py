"""Relume's command line for farms that start Blender with factory settings, and for the `bpy` module:

    blender -b shot.blend -P relume_bake.py -- bake --out FOLDER
    python relume_bake.py shot.blend -- bake --out FOLDER

The script finds the add-on beside itself, so the extension need not be enabled.
"""

import importlib.util
import os
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
    """What follows `--`."""
    if "--" in sys.argv:
        return sys.argv[sys.argv.index("--") + 1 :]
    words = [] if bpy.app.binary_path else [word for word in sys.argv[1:] if not word.endswith(".blend")]
    if words and not words[0].startswith("-"):
        sys.exit(f"Error: the command comes after --: python relume_bake.py shot.blend -- {' '.join(words)}")
    return ["--help"]


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
    asked = arguments()
    open_file()
    if "cycles" not in bpy.context.preferences.addons:
        bpy.ops.preferences.addon_enable(module="cycles")
    load_addon()
    from relume_addon.commands import main as run
    from relume_addon.engine.process import end_with_owner

    end_with_owner()
    with native_module():
        code = run(asked)
    os._exit(code)


if __name__ == "__main__":
    main()
