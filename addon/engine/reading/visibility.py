"""Visibility of lights: objects, collections and modifiers that hide a light which is not hidden itself."""

from __future__ import annotations

import bpy

from ...core.words import listed
from ...export.instancers import Instancers
from ...export.lights import name_of
from .scene_lights import SceneLights


def hidden_by(context: bpy.types.Context, light: bpy.types.Object) -> str | None:
    """Reason why a light that is not hidden itself gives no light, in words; None if it does, in place or instanced."""
    view_layer = context.view_layer
    lights = SceneLights(view_layer.name, [])
    lights.read(context.evaluated_depsgraph_get(), 0.0)
    if lights.shows(light.session_uid):
        return None
    instancers = Instancers()
    owners = _owners_of(light, context.scene, instancers)
    ways = {light, *owners}
    hidden = _hidden_collections(view_layer)
    collections = [collection for collection in hidden if not ways.isdisjoint(collection.all_objects)]
    objects = [obj for obj in owners if _is_hidden(obj, view_layer)]
    switched_off = [obj for obj in owners if any(_is_off(modifier, ways, instancers) for modifier in obj.modifiers)]
    hiders_by_kind = {"collection": collections, "object": objects, "a switched-off modifier of": switched_off}
    named = [f"by {kind} {listed(sorted(map(name_of, hiders)))}" for kind, hiders in hiders_by_kind.items() if hiders]
    return " and ".join(named) or "though nothing is switched off: what could show it has no instance of it"


def _is_off(modifier: bpy.types.Modifier, ways: set[bpy.types.Object], instancers: Instancers) -> bool:
    """True if a modifier that would show some of the objects is switched off in renders or views."""
    is_on = modifier.show_render and modifier.show_viewport
    return not is_on and not ways.isdisjoint(instancers.placed_by_modifier(modifier))


def _owners_of(light: bpy.types.Object, scene: bpy.types.Scene, instancers: Instancers) -> list[bpy.types.Object]:
    """Objects through whose instances a scene may show a light, hidden or not."""
    placed: dict[bpy.types.Object, set[bpy.types.Object]] = {}
    todo = list(scene.objects)
    while todo:
        obj = todo.pop()
        if obj not in placed:
            placed[obj] = instancers.placed_by(obj)
            todo += placed[obj]
    owners: dict[bpy.types.Object, None] = {}
    reached = [light]
    while reached:
        inner = reached.pop()
        outer = [obj for obj, inside in placed.items() if inner in inside and obj not in owners]
        owners |= dict.fromkeys(outer)
        reached += outer
    return list(owners)


def _is_hidden(obj: bpy.types.Object, view_layer: bpy.types.ViewLayer) -> bool:
    is_here = view_layer.objects.get(obj.name) is obj
    return obj.hide_render or obj.hide_viewport or (is_here and obj.hide_get(view_layer=view_layer))


def _hidden_collections(view_layer: bpy.types.ViewLayer) -> set[bpy.types.Collection]:
    """All collections that are hidden in renders or in the view."""
    layers, hidden = [view_layer.layer_collection], set()
    while layers:
        layer = layers.pop()
        layers += layer.children
        if layer.exclude or layer.hide_viewport:
            hidden.add(layer.collection)
    return hidden | {each for each in bpy.data.collections if each.hide_render or each.hide_viewport}
