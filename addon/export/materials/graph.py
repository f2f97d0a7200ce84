"""Follows links through groups, reroutes and muted nodes to the node that really feeds a socket."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from ...core.blackbody import blackbody_color

Context = tuple[bpy.types.Node, ...]
"""The group nodes around a node, outermost first."""

LUMINANCE = (0.2126, 0.7152, 0.0722)
"""Weights of linear Rec.709, Cycles' conversion from colour to float."""

Value = float | list[float]


def used_tree(block: bpy.types.ID) -> bpy.types.NodeTree | None:
    """The node tree of a material, light or world, if it counts. From Blender 5.2 on it always does, and asking
    `use_nodes` is deprecated."""
    if bpy.app.version < (5, 2, 0) and not block.use_nodes:
        return None
    return block.node_tree


class Source(NamedTuple):
    """An output socket of a node that is no reroute, group or muted node."""

    node: bpy.types.Node
    socket: bpy.types.NodeSocket
    context: Context


class Unlinked(NamedTuple):
    """An input socket without a link: its default value counts. The socket may belong to a group around."""

    socket: bpy.types.NodeSocket


def trace(socket: bpy.types.NodeSocket, context: Context) -> Source | Unlinked | None:
    """What feeds `socket`; None if a link ends nowhere, for example in a muted node without an equal input."""
    while True:
        link = next((link for link in socket.links if not link.is_muted and link.is_valid), None)
        if link is None:
            return Unlinked(socket)
        node, output = link.from_node, link.from_socket
        if node.bl_idname == "NodeReroute":
            socket = node.inputs[0]
        elif node.mute:
            inner = next((link for link in node.internal_links if link.to_socket == output), None)
            if inner is None:
                return None
            socket = inner.from_socket
        elif node.bl_idname == "ShaderNodeGroup":
            group_output = _group_output(node)
            if group_output is None:
                return None
            socket, context = _by_identifier(group_output.inputs, output.identifier), (*context, node)
        elif node.bl_idname == "NodeGroupInput":
            if not context:
                return None
            socket, context = _by_identifier(context[-1].inputs, output.identifier), context[:-1]
        else:
            return Source(node, output, context)
        if socket is None:
            return None


def resolve(socket: bpy.types.NodeSocket, context: Context) -> Source | None:
    """The node that feeds `socket`, or None if none does."""
    source = trace(socket, context)
    return source if isinstance(source, Source) else None


def constant_value(socket: bpy.types.NodeSocket, context: Context) -> Value | None:
    """The value of a socket that nothing but a constant feeds, as this socket sees it; None otherwise."""
    return constant_of(trace(socket, context), socket)


def constant_of(source: Source | Unlinked | None, socket: bpy.types.NodeSocket) -> Value | None:
    """The value of what feeds `socket` (as `trace` finds it), as `socket` sees it; None if it is no constant."""
    if source is None:
        return convert([0.0, 0.0, 0.0], socket, is_color=True)
    if isinstance(source, Unlinked):
        value = socket_default(source.socket)
        return None if value is None else convert(value, socket, source.socket.type == "RGBA")
    value = node_constant(source)
    return None if value is None else convert(value, socket, source.socket.type == "RGBA")


def node_constant(source: Source) -> Value | None:
    """The output of a node that is a constant by itself."""
    if source.node.bl_idname == "ShaderNodeRGB":
        return list(source.socket.default_value)[:3]
    if source.node.bl_idname == "ShaderNodeValue":
        return float(source.socket.default_value)
    if source.node.bl_idname == "ShaderNodeBlackbody":
        kelvin = constant_value(source.node.inputs["Temperature"], source.context)
        return blackbody_color(kelvin) if isinstance(kelvin, float) else None
    return None


def socket_default(socket: bpy.types.NodeSocket) -> Value | None:
    """The value shown on an unlinked socket; None for sockets that show none (normals, texture vectors)."""
    if socket.type in {"SHADER", "STRING", "OBJECT", "IMAGE", "GEOMETRY"} or socket.hide_value:
        return None
    value = getattr(socket, "default_value", None)
    if value is None:
        return None
    return float(value) if isinstance(value, int | float) else list(value)[:3]


def convert(value: Value, to: bpy.types.NodeSocket, is_color: bool) -> Value:
    """Blender's implicit conversions between floats, colours and vectors."""
    if to.type in {"RGBA", "VECTOR"}:
        return value if isinstance(value, list) else [value] * 3
    if isinstance(value, list):
        weights = LUMINANCE if is_color else (1.0 / 3.0,) * 3
        return sum(weight * channel for weight, channel in zip(weights, value, strict=True))
    return value


def _group_output(group: bpy.types.Node) -> Any:
    if group.node_tree is None:
        return None
    outputs = [node for node in group.node_tree.nodes if node.bl_idname == "NodeGroupOutput"]
    return next((node for node in outputs if node.is_active_output), outputs[0] if outputs else None)


def _by_identifier(sockets: Any, identifier: str) -> Any:
    return next((socket for socket in sockets if socket.identifier == identifier), None)
