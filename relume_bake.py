"""Relume's command line for farms that start Blender with factory settings, and for the `bpy` module:

    blender -b shot.blend -P relume_bake.py -- bake --out FOLDER
    python relume_bake.py shot.blend -- bake --out FOLDER

The script takes the add-on of its checkout, or the unpacked extension beside it (`relume`), or the installed one. The
extension need not be enabled.
"""

import importlib.util
import sys
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import bpy

PACKAGE = "relume_addon"


def find_addon():
    """Folder of the add-on; ends with words where there is none."""
    here = Path(__file__).resolve().parent
    places = [here / "addon", here / "relume"]
    for kind in ("USER", "SYSTEM"):
        if root := bpy.utils.resource_path(kind):
            places += sorted(Path(root).glob("extensions/*/relume"))
    found = next((place for place in places if (place / "blender_manifest.toml").is_file()), None)
    if found is None:
        sys.exit(f"Error: Relume is neither installed nor unpacked as {here / 'relume'}")
    return found


def load(name, folder):
    """A package from a folder, whatever that is called."""
    spec = importlib.util.spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)


@contextmanager
def native_module(addon):
    """Loads the package `relume`. With factory settings Blender does not look where it unpacked the extension's wheel,
    and it unpacks that only once the extension is enabled: then this does, for as long as the command runs."""
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    unpacked = addon.parents[1] / ".local" / "lib" / python / "site-packages"
    wheels = list((addon / "wheels").glob("relume-*.whl"))
    with ExitStack() as stack:
        if importlib.util.find_spec("relume") is None:
            if not (unpacked / "relume").is_dir() and wheels:
                # Windows cannot remove a library in use.
                folder = TemporaryDirectory(prefix="relume-", ignore_cleanup_errors=True)
                unpacked = Path(stack.enter_context(folder))
                ZipFile(wheels[0]).extractall(unpacked)
            if (unpacked / "relume").is_dir():
                load("relume", unpacked / "relume")
        yield


def main():
    """Loads the add-on, and runs its command line."""
    addon = find_addon()
    try:
        load(PACKAGE, addon)
        from relume_addon import own_process

        with native_module(addon):
            own_process.main()
    except Exception as error:  # Blender itself would end as if all were well.
        sys.exit(f"Error: Relume could not be started: {error!r}")


if __name__ == "__main__":
    main()
