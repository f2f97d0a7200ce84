"""The native module, imported at first use: a loaded library cannot be updated on Windows, and an add-on that fails
to load it must still be able to say why."""

from __future__ import annotations

from types import ModuleType


class NativeModuleError(Exception):
    """The native module is missing or does not fit; the message says what to do."""


def native() -> ModuleType:
    """The module `relume`."""
    try:
        import relume
    except ImportError as error:
        raise NativeModuleError(
            f"Relume's native module could not be loaded ({error}); reinstall the extension and restart Blender"
        ) from error
    return relume
