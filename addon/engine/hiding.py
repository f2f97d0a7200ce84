"""What hides a light that is not hidden itself."""

from __future__ import annotations

import bpy

from ..core.words import listed
from ..export.instancers import Instancers
from ..export.lights import name_of
from .scene_lights import SceneLights


def still_hides(context: bpy.types.Context, light: bpy.types.Object) -> str | None:
    """What hides a light that is not hidden itself, in words; None if it gives light, where it is or as an instance."""
    view_layer = context.view_layer
    lights = SceneLights(view_layer.name, [])
    lights.read(context.evaluated_depsgraph_get(), 0.0)
    if lights.shows(light.session_uid):
        return None
    instancers = Instancers()
    owners = _owners_of(light, context.scene, instancers)
    ways = {light, *owners}
    collections = [found for found in _hidden_collections(view_layer) if not ways.isdisjoint(found.all_objects)]
    objects = [obj for obj in owners if _is_hidden(obj, view_layer)]
    switched_off = [obj for obj in owners if any(_is_off(found, ways, instancers) for found in obj.modifiers)]
    blocks = {"collection": collections, "object": objects, "a switched-off modifier of": switched_off}
    named = [f"by {kind} {listed(sorted(map(name_of, found)))}" for kind, found in blocks.items() if found]
    return " and ".join(named) or "though nothing is switched off: what could show it has no instance of it"


def _is_off(modifier: bpy.types.Modifier, ways: set[bpy.types.Object], instancers: Instancers) -> bool:
    """Whether renders or views lack what a modifier would show of some objects."""
    is_on = modifier.show_render and modifier.show_viewport
    return not is_on and not ways.isdisjoint(instancers.placed_by_modifier(modifier))


def _owners_of(light: bpy.types.Object, scene: bpy.types.Scene, instancers: Instancers) -> list[bpy.types.Object]:
    """Objects by way of which a scene may show a light, hidden or not."""
    placed: dict[bpy.types.Object, set[bpy.types.Object]] = {}
    todo = list(scene.objects)
    while todo:
        obj = todo.pop()
        if obj not in placed:
            placed[obj] = instancers.placed_by(obj)
            todo += placed[obj]
    found: dict[bpy.types.Object, None] = {}
    reached = [light]
    while reached:
        inner = reached.pop()
        outer = [obj for obj, inside in placed.items() if inner in inside and obj not in found]
        found |= dict.fromkeys(outer)
        reached += outer
    return list(found)


def _is_hidden(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> bool:
    is_here = view_layer.objects.get(obj.name) is obj
    return obj.hide_render or obj.hide_viewport or (is_here and obj.hide_get(view_layer=view_layer))


def _hidden_collections(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Collection]:
    """All collections that something hides, in renders or in the view."""
    layers, hidden = [view_layer.layer_collection], set()
    while layers:
        layer = layers.pop()
        layers += layer.children
        if layer.exclude or layer.hide_viewport:
            hidden.add(layer.collection)
    return hidden | {found for found in bpy.data.collections if found.hide_render or found.hide_viewport}
