"""Relume: relights a finished shot with real materials and full global illumination."""

from __future__ import annotations

import bpy

COMMAND = "relume"

_registered: list[object] = []


def _run_command(arguments: list[str]) -> int:
    """Imports the native module at first use only, so that it can be updated while it is not in use."""
    from .engine.commands import main

    return main(arguments)


def register():
    """Called by Blender when the extension is enabled."""
    _registered.append(bpy.utils.register_cli_command(COMMAND, _run_command))


def unregister():
    """Called by Blender when the extension is disabled."""
    while _registered:
        bpy.utils.unregister_cli_command(_registered.pop())
