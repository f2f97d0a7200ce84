"""Compositing of a picture by its lights: a node group that adds up the passes, each with an exposure and a tint."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy

GROUP = "Relume Mix"
FRAME = "Relume"
IS_GROUP = bpy.app.version >= (5, 0, 0)
"""The compositor of a scene is a node group, since Blender 5.0."""


def set_up(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, passes: Iterable[str]) -> bool:
    """Adds nodes to the compositor that rebuild the picture of a view layer from its passes. What is there stays as it
    is: the nodes are linked to the output only if the scene had no compositor. Returns whether they are."""
    is_new = scene.compositing_node_group is None if IS_GROUP else not scene.use_nodes
    tree = _tree(scene)
    if is_new:
        tree.nodes.clear()
    passes = list(passes)
    frame = tree.nodes.new("NodeFrame")
    frame.label = FRAME
    layers = tree.nodes.new("CompositorNodeRLayers")
    layers.scene, layers.layer = scene, layer.name
    mix = tree.nodes.new("CompositorNodeGroup")
    mix.node_tree, mix.width = _group(passes), 240.0
    left, top = _free_place(tree, {frame, layers, mix})
    for node, x in ((layers, 0.0), (mix, 320.0)):
        node.parent, node.location = frame, (left + x, top)
    tree.links.new(layers.outputs["Alpha"], mix.inputs["Alpha"])
    for name in passes:
        tree.links.new(layers.outputs[name], mix.inputs[name])
    if is_new:
        output = _output(tree)
        output.location = (left + 640.0, top)
        tree.links.new(mix.outputs["Image"], output.inputs[0])
    return is_new


def _tree(scene: bpy.types.Scene) -> bpy.types.NodeTree:
    if not IS_GROUP:
        scene.use_nodes = True
        return scene.node_tree
    if scene.compositing_node_group is None:
        tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
    return scene.compositing_node_group


def _output(tree: bpy.types.NodeTree) -> bpy.types.Node:
    return tree.nodes.new("NodeGroupOutput" if IS_GROUP else "CompositorNodeComposite")


def _free_place(tree: bpy.types.NodeTree, own: set[Any]) -> tuple[float, float]:
    """A place below all other nodes."""
    others = [node for node in tree.nodes if node not in own]
    left = min((node.location.x for node in others), default=0.0)
    return left, min((node.location.y - 400.0 for node in others), default=0.0)


def _group(passes: list[str]) -> bpy.types.NodeTree:
    """A group that adds up images, each times its tint and two to the power of its exposure."""
    group = bpy.data.node_groups.new(GROUP, "CompositorNodeTree")
    socket = group.interface.new_socket
    for name in passes:
        socket(name, in_out="INPUT", socket_type="NodeSocketColor")
        exposure = socket(f"{name} Exposure", in_out="INPUT", socket_type="NodeSocketFloat")
        exposure.min_value, exposure.max_value = -10.0, 10.0
        tint = socket(f"{name} Tint", in_out="INPUT", socket_type="NodeSocketColor")
        tint.default_value = (1.0, 1.0, 1.0, 1.0)
    socket("Alpha", in_out="INPUT", socket_type="NodeSocketFloat").default_value = 1.0
    socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    inputs, output = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    link = group.links.new
    total = None
    for row, name in enumerate(passes):
        exposed = group.nodes.new("CompositorNodeExposure")
        link(inputs.outputs[name], exposed.inputs["Image"])
        link(inputs.outputs[f"{name} Exposure"], exposed.inputs["Exposure"])
        exposed.location = (200.0, -200.0 * row)
        tinted = _mixed(group, "MULTIPLY", exposed.outputs[0], inputs.outputs[f"{name} Tint"])
        tinted.location = (400.0, -200.0 * row)
        if total is not None:
            tinted, before = _mixed(group, "ADD", total, _result(tinted)), tinted
            tinted.location = before.location.x + 200.0, before.location.y
        total = _result(tinted)
    with_alpha = group.nodes.new("CompositorNodeSetAlpha")
    if hasattr(with_alpha, "mode"):
        with_alpha.mode = "REPLACE_ALPHA"
    else:
        with_alpha.inputs["Type"].default_value = "Replace Alpha"
    with_alpha.location, output.location = (800.0, 0.0), (1000.0, 0.0)
    if total is not None:
        link(total, with_alpha.inputs["Image"])
    link(inputs.outputs["Alpha"], with_alpha.inputs["Alpha"])
    link(with_alpha.outputs[0], output.inputs[0])
    return group


def _mixed(group: bpy.types.NodeTree, how: str, a: Any, b: Any) -> bpy.types.Node:
    node = group.nodes.new("ShaderNodeMix" if IS_GROUP else "CompositorNodeMixRGB")
    node.blend_type = how
    if IS_GROUP:
        node.data_type = "RGBA"
        node.clamp_factor = False
    factor, *colors = [socket for socket in node.inputs if socket.enabled]
    factor.default_value = 1.0
    for color, value in zip(colors, (a, b), strict=True):
        group.links.new(value, color)
    return node


def _result(node: bpy.types.Node) -> Any:
    """The output of a mix that is shown for its type of data."""
    return next(socket for socket in node.outputs if socket.enabled)
