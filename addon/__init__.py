"""Relume: relights a finished shot with real materials and full global illumination."""

from __future__ import annotations

import bpy

from . import ui

COMMAND = "relume"

_registered: list[object] = []


def _run_command(arguments: list[str]) -> int:
    """Imports the native module at first use only, so that it can be updated while it is not in use."""
    from .commands import main

    return main(arguments)


def register():
    """Called by Blender when the extension is enabled."""
    _registered.append(bpy.utils.register_cli_command(COMMAND, _run_command))
    for module in ui.MODULES:
        module.register()


def unregister():
    """Called by Blender when the extension is disabled. Takes everything back, in reverse order."""
    for module in reversed(ui.MODULES):
        module.unregister()
    while _registered:
        bpy.utils.unregister_cli_command(_registered.pop())
