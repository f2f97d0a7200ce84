"""Things in a file that may differ for another camera of its scene, before the scene is read at all."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

ACTIVE_CAMERA = "GeometryNodeInputActiveCamera"


def asks_for_camera() -> bool:
    """True if geometry nodes ask for the scene's camera, or a driver may: one that reads a scene or runs Python."""
    groups = bpy.data.node_groups
    if any(node.bl_idname == ACTIVE_CAMERA for group in groups for node in group.nodes):
        return True
    return any(map(_may_ask, _drivers()))


def _drivers() -> Iterator[bpy.types.Driver]:
    collections = [prop.identifier for prop in bpy.data.bl_rna.properties if prop.type == "COLLECTION"]
    for block in (block for name in collections for block in getattr(bpy.data, name)):
        for owner in (block, getattr(block, "node_tree", None)):
            data = getattr(owner, "animation_data", None)
            yield from (curve.driver for curve in data.drivers) if data is not None else ()


def _may_ask(driver: Any) -> bool:
    if driver.type == "SCRIPTED" and not driver.is_simple_expression:
        return True
    variables = driver.variables
    reads_context = any(variable.type == "CONTEXT_PROP" for variable in variables)
    return reads_context or any(isinstance(target.id, bpy.types.Scene) for each in variables for target in each.targets)
