"""Fingerprints of objects: their place, switches, modifiers and what materials ask them for."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.diff import Fingerprint
from ...export.culling import SWITCHES
from ...export.curves import hides_hair
from ...export.instancers import node_inputs
from ...export.linking import link_states
from ...export.materials.graph import used_tree
from ...export.motion import motion_settings
from ...export.object_attributes import find_rgba
from ...export.plain import plain
from ...export.scene import occlusion_distance, shadow_terminator
from .dependencies import nodes_in
from .node_fingerprints import drawn_curves, hashed, values


def matrix_text(matrix: Any) -> str:
    """Exact to six digits: evaluating a file again may differ by a rounding."""
    return hashed([f"{value:.6g}" for row in matrix for value in row])


def object_fingerprint(obj: bpy.types.Object) -> Fingerprint:
    """Fingerprint of an object, without its data."""
    visible = ("camera", "diffuse", "glossy", "transmission", "shadow")
    found = {
        "place": matrix_text(obj.matrix_world),
        "visibility": hashed([getattr(obj, f"visible_{name}") for name in visible]),
        "shading": hashed([*obj.color, obj.pass_index, *shadow_terminator(obj)]),
    }
    if not obj.visible_volume_scatter:
        found["scatter"] = "hidden"
    if not getattr(obj, "visible_raycast", True):  # From Blender 5.3 on.
        found["raycast"] = "hidden"
    if obj.is_holdout:
        found["holdout"] = "on"
    if obj.is_shadow_catcher and obj.type != "LIGHT":
        found["catcher"] = "on"
    if distance := occlusion_distance(obj):
        found["occlusion"] = f"{distance:.6g}"
    if (cycles := getattr(obj, "cycles", None)) and any(getattr(cycles, switch, False) for switch in SWITCHES):
        found["culling"] = hashed([getattr(cycles, switch) for switch in SWITCHES])
    if linked := _linked(obj):
        found["linking"] = hashed(linked)
    if asked := _asked_of(obj):
        found["attributes"] = hashed(asked)
    if obj.data is not None:
        found["data"] = obj.data.name_full
    elif obj.instance_collection is not None:
        found["data"] = obj.instance_collection.name_full
    if obj.material_slots:
        found["materials"] = hashed([slot.material.name_full if slot.material else "" for slot in obj.material_slots])
    if obj.modifiers:
        found["modifiers"] = hashed([_modifier(modifier) for modifier in obj.modifiers])
        found["details"] = hashed([_modifier_details(modifier) for modifier in obj.modifiers])
    if (dicing := getattr(obj, "cycles", None)) is not None and getattr(dicing, "use_adaptive_subdivision", False):
        found["subdivision"] = f"{dicing.dicing_rate:.6g}"  # Until Blender 4.5; then the modifier's.
    if (settings := motion_settings(obj)) is not None:
        found["motion"] = hashed(settings)
    if obj.pose:
        found["pose"] = hashed([matrix_text(bone.matrix) for bone in obj.pose.bones])
    return found


def _linked(obj: bpy.types.Object) -> list:
    """Members of the collections that an object shines on, and that block its light; those of lights are read anew for
    each picture."""
    linking = getattr(obj, "light_linking", None)
    if linking is None or obj.type == "LIGHT":
        return []
    collections = [linking.receiver_collection, linking.blocker_collection]
    return [sorted(link_states(each).items()) if each else None for each in collections] if any(collections) else []


def _asked_of(obj: bpy.types.Object) -> list:
    """Custom properties that an object's materials may ask it, its data or what it instances for. Costs next to nothing
    where there are none."""
    owners = [owner for owner in (obj, obj.data) if owner is not None and len(owner.keys())]
    names = {
        node.attribute_name
        for material in (bpy.data.materials if owners else ())
        for node in nodes_in(used_tree(material))
        if getattr(node, "attribute_type", "") in {"OBJECT", "INSTANCER"}
    }
    return [(name, find_rgba(owner, name)) for owner in owners for name in sorted(names) if name in owner.keys()]


def _modifier(modifier: bpy.types.Modifier) -> list:
    inputs = [(name, plain(value)) for name, value in node_inputs(modifier)] if modifier.type == "NODES" else []
    return [modifier.type, modifier.show_render, values(modifier), inputs]


def _modifier_details(modifier: bpy.types.Modifier) -> list:
    domain = getattr(modifier, "domain_settings", None)
    projectors = [projector.object and projector.object.name_full for projector in getattr(modifier, "projectors", ())]
    system = values(modifier.particle_system) if modifier.type == "PARTICLE_SYSTEM" else []
    hidden = [True] if modifier.type == "PARTICLE_SYSTEM" and hides_hair(modifier.id_data) else []
    return [drawn_curves(modifier), projectors, system, *([values(domain)] if domain else []), *hidden]
