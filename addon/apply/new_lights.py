"""Makes the lights that a look adds to a scene, in a collection of their own."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

COLLECTION = "Relume"


def refusals(scene: bpy.types.Scene, states: Iterable[dict[str, Any]]) -> list[str]:
    """Reasons why the lights of some states cannot be made, a line each."""
    collection = _collection(scene)
    reasons = []
    for state in states:
        if state["type"] not in {"POINT", "SPOT", "AREA", "SUN"}:
            reasons.append(f"light '{state['name']}' cannot be of type '{state['type']}'")
        elif collection is not None and not collection.is_editable:
            reasons.append(f"light '{state['name']}' belongs into collection '{COLLECTION}', which is linked")
    return reasons


def make(scene: bpy.types.Scene, states: Iterable[dict[str, Any]]) -> list[bpy.types.Object]:
    """Makes a plain light of the name and type of each state; its settings are still to be written."""
    states = list(states)
    if not states:
        return []
    collection = _collection(scene)
    if collection is None:
        collection = bpy.data.collections.new(COLLECTION)
        scene.collection.children.link(collection)
    made = []
    for state in states:
        obj = bpy.data.objects.new(state["name"], bpy.data.lights.new(state["name"], state["type"]))
        collection.objects.link(obj)
        made.append(obj)
    return made


def _collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    return next(
        (collection for collection in scene.collection.children_recursive if collection.name == COLLECTION), None
    )
