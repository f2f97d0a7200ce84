"""The name of a scene's render engine, in Blender's memory. Where Python sets it Blender ends what all views draw and
begins it anew: seconds, and the samples of a view that Cycles draws."""

from __future__ import annotations

import ctypes

import bpy

SIZE = 32
"""Bytes of the name, its end included (`RenderData.engine` in Blender's `DNA_scene_types.h`)."""
LARGEST = 16384
"""Bytes between the beginnings of render settings and units; 4568 in Blender 5.2. More is not what is known here."""


def set_engine_unseen(scene: bpy.types.Scene, engine: str) -> bool:
    """Gives a scene a registered engine, of which nothing in Blender is told: for a moment in which the main thread
    draws nothing. Whether it did; it does nothing where the name is not found in one place of the scene's render
    settings."""
    name = engine.encode() + b"\0"
    address = _address(scene)
    if address is None or len(name) > SIZE:
        return False
    ctypes.memmove(address, name, len(name))
    return True


def _address(scene: bpy.types.Scene) -> int | None:
    """Where the name is. The render settings are a part of the scene, and its units a later one."""
    first, end = scene.render.as_pointer(), scene.unit_settings.as_pointer()
    name = scene.render.engine.encode() + b"\0"
    if not name[:-1] or not 0 < end - first < LARGEST:
        return None
    memory = ctypes.string_at(first, end - first)
    place = memory.find(name)
    return first + place if place >= 0 and memory.count(name) == 1 and place + SIZE <= len(memory) else None
