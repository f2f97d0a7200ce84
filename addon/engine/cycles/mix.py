"""The mix written into a scene for Cycles. Only ever on a copy of the file: lights are changed, nodes are added."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.rows import LIGHT
from ...export.light_tree import light_tree
from ...export.lights import name_of
from ...export.materials.graph import used_tree

NEUTRAL = [1.0, 1.0, 1.0]
EMISSION_INPUTS = {
    "ShaderNodeEmission": "Color",
    "ShaderNodeBackground": "Color",
    "ShaderNodeBsdfPrincipled": "Emission Color",
}


def write_mix(scene: bpy.types.Scene, mix: dict[str, Any]) -> None:
    """Multiplies lights by their names, the world and all emissive materials by the gains of `mix`."""
    for line in light_tree(scene):
        gain = mix["gains"].get(name_of(line.block), NEUTRAL)
        if line.kind == LIGHT and gain != NEUTRAL:
            _scale_light(line.block, gain)
    if scene.world is not None and mix["world"] != NEUTRAL:
        _scale_world(scene.world, mix["world"])
    if mix["static"] != NEUTRAL:
        seen: set[str] = set()
        for material in bpy.data.materials:
            tree = used_tree(material)
            if tree is not None:
                _scale_emission(tree, mix["static"], seen)


def _scale_light(obj: bpy.types.Object, gain: list[float]) -> None:
    largest = max(gain)
    if largest <= 0.0:
        obj.animation_data_clear()
        obj.hide_render = True
        return
    # Other lights may share the data, and animation would write over it.
    light = obj.data = obj.data.copy()
    light.animation_data_clear()
    light.energy *= largest
    light.color = [channel * factor / largest for channel, factor in zip(light.color, gain, strict=True)]


def _scale_world(world: bpy.types.World, gain: list[float]) -> None:
    tree = used_tree(world)
    if tree is not None:
        _scale_emission(tree, gain, set())
    else:
        world.color = [channel * factor for channel, factor in zip(world.color, gain, strict=True)]


def _scale_emission(tree: bpy.types.NodeTree, gain: list[float], seen: set[str]) -> None:
    if tree.name_full in seen and not tree.is_embedded_data:
        return
    seen.add(tree.name_full)
    for node in list(tree.nodes):
        if node.type == "GROUP" and node.node_tree is not None:
            _scale_emission(node.node_tree, gain, seen)
        if node.bl_idname in EMISSION_INPUTS:
            _scale_input(tree, node.inputs[EMISSION_INPUTS[node.bl_idname]], gain)


def _scale_input(tree: bpy.types.NodeTree, socket: bpy.types.NodeSocket, gain: list[float]) -> None:
    if not socket.is_linked:
        socket.default_value = [a * b for a, b in zip(socket.default_value, [*gain, 1.0], strict=True)]
        return
    product = tree.nodes.new("ShaderNodeVectorMath")
    product.operation = "MULTIPLY"
    tree.links.new(socket.links[0].from_socket, product.inputs[0])
    product.inputs[1].default_value = gain
    tree.links.new(product.outputs[0], socket)
