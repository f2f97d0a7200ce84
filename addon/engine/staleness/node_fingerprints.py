"""Everything that node trees and other settings compute with, as values whose text can be hashed."""

from __future__ import annotations

import zlib
from collections.abc import Generator
from typing import Any

import bpy

from ...export.materials.coordinates import is_mapped
from ...export.object_attributes import value_of_layer
from ...export.plain import SIMPLE, effective_properties, plain
from ...export.view_layer import render_layer

VIEWER = "GeometryNodeViewer"
"""Shows what is computed, and computes nothing."""


def hashed(value: Any) -> str:
    """A short text that differs where the value does."""
    return f"{zlib.crc32(value if isinstance(value, bytes) else repr(value).encode()):08x}"


def values(struct: Any) -> list:
    """Simple settings of any part of a file."""
    found = []
    for prop in effective_properties(struct):
        name = prop.identifier
        if prop.type in SIMPLE:
            found.append((name, plain(getattr(struct, name))))
        elif prop.type == "POINTER":
            target = getattr(struct, name)
            found.append((name, target.name_full if isinstance(target, bpy.types.ID) else ""))
    return found


def drawn_curves(struct: Any) -> list:
    """The curves and profiles that are drawn among the settings of a modifier or data-block."""
    found: list[Any] = []
    for prop in struct.bl_rna.properties:
        target = getattr(struct, prop.identifier) if prop.type == "POINTER" else None
        if isinstance(target, bpy.types.CurveMapping):
            found.append([[(*point.location, point.handle_type) for point in curve.points] for curve in target.curves])
        elif isinstance(target, bpy.types.CurveProfile):
            found.append([values(point) for point in target.points])
    return found


def ramp(owner: Any) -> list:
    """The colour ramp of a node or texture, if it has one."""
    found = getattr(owner, "color_ramp", None)
    return [found.interpolation, [(stop.position, tuple(stop.color)) for stop in found.elements]] if found else []


def tree(shader: bpy.types.NodeTree) -> list:
    """A node tree and the groups in it."""
    return [[_with_group(node) for node in shader.nodes if _computes(node)], _links(shader)]


def group(geometry: bpy.types.NodeTree) -> Generator[None, None, list]:
    """A node tree without the groups in it, a node at a time."""
    found = []
    for name in [node.name for node in geometry.nodes]:
        yield
        # By its name: an edit may have freed it.
        if (node := geometry.nodes.get(name)) is not None and _computes(node):
            found.append(_node(node))
    return [found, _links(geometry)]


def _computes(node: bpy.types.Node) -> bool:
    return node.bl_idname not in {"NodeFrame", "NodeReroute", VIEWER}


def _links(of: bpy.types.NodeTree) -> list:
    return sorted(
        (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        for link in of.links
        if not link.is_muted and link.to_node.bl_idname != VIEWER
    )


def _with_group(node: bpy.types.Node) -> list:
    found = _node(node)
    if (inner := getattr(node, "node_tree", None)) is not None:
        found[-1].append(tree(inner))
    return found


def _node(node: bpy.types.Node) -> list:
    inputs = [plain(socket.default_value) for socket in node.inputs if hasattr(socket, "default_value")]
    outputs = [plain(socket.default_value) for socket in node.outputs if hasattr(socket, "default_value")]
    extra: list[Any] = []
    if colors := ramp(node):
        extra.append(colors)
    if (mapping := getattr(node, "mapping", None)) is not None and hasattr(mapping, "curves"):
        extra.append([[tuple(point.location) for point in curve.points] for curve in mapping.curves])
    if (image := getattr(node, "image", None)) is not None:
        extra.append([image.filepath, image.colorspace_settings.name])
    if getattr(node, "attribute_type", "") == "VIEW_LAYER":
        scene = bpy.context.scene
        extra.append(value_of_layer(scene, render_layer(scene), node.attribute_name))
    if (mapping := getattr(node, "texture_mapping", None)) is not None and is_mapped(node):
        extra.append(values(mapping))
    if not getattr(node, "is_active_output", True):
        extra.append("inactive")
    return [node.name, node.bl_idname, node.mute, values(node), inputs, outputs, extra]
