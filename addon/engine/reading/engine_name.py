"""The name of a scene's render engine, in Blender's memory. Where Python sets it Blender ends what all views draw and
begins it anew: seconds, and the samples of a view that Cycles draws."""

from __future__ import annotations

import ctypes

import bpy

SIZE = 32
"""Bytes of the name, its end included (`RenderData.engine` in Blender's `DNA_scene_types.h`)."""
LARGEST = 16384
"""Bytes between the beginnings of render settings and units; 4568 in Blender 5.2. More is not what is known here."""


def address_of_engine(scene: bpy.types.Scene) -> int | None:
    """Address of the name; None unless it is found in exactly one place of the scene's render settings. Those are a
    part of the scene, and its units are a later one."""
    first, end = scene.render.as_pointer(), scene.unit_settings.as_pointer()
    name = scene.render.engine.encode() + b"\0"
    if len(name) == 1 or not 0 < end - first < LARGEST:
        return None
    memory = ctypes.string_at(first, end - first)
    place = memory.find(name)
    return first + place if memory.count(name) == 1 and place + SIZE <= len(memory) else None


def set_engine_unseen(address: int, engine: str) -> None:
    """Writes the name of a registered engine, of which nothing in Blender is told: for a moment in which the main
    thread draws nothing and the scene stays where it is."""
    name = engine.encode()[: SIZE - 1] + b"\0"
    ctypes.memmove(address, name, len(name))
