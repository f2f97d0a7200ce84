"""The native module, imported at first use: a loaded library cannot be updated on Windows, and an add-on that fails
to load it must still be able to say why."""

from __future__ import annotations

import functools
import tomllib
from types import ModuleType

from ..core.own_files import addon_folder


class NativeModuleError(Exception):
    """The native module is missing or does not fit; the message says what to do."""


def native() -> ModuleType:
    """The module `relume`. After an update Blender goes on with the one that it has loaded, until it is restarted."""
    try:
        import relume
    except ImportError as error:
        raise NativeModuleError(
            f"Relume's native module could not be loaded ({error}); reinstall the extension and restart Blender"
        ) from error
    if relume.__version__ != _wanted_version():
        raise NativeModuleError(
            f"Relume was updated to {_wanted_version()} while its native module {relume.__version__} is loaded; "
            "restart Blender"
        )
    return relume


@functools.cache
def _wanted_version() -> str:
    manifest = addon_folder() / "blender_manifest.toml"
    return tomllib.loads(manifest.read_text(encoding="utf-8"))["version"]
