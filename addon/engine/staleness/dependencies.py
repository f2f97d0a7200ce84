"""Data-blocks that the geometry of a scene depends on and no render shows: cutters, targets, groups of nodes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import bpy

from ...export.instancers import node_inputs
from ...export.materials.graph import used_tree
from ...export.plain import effective_properties

NODES_A_STEP = 10


def dependencies_of(block: bpy.types.ID) -> Iterator[bpy.types.ID | None]:
    """The data-blocks that one computes with; None where there is time for something else, as node groups are large."""
    if isinstance(block, bpy.types.Object):
        yield from _of_object(block)
    elif isinstance(block, (bpy.types.Material, bpy.types.World)):
        yield from (node.image for node in image_nodes(used_tree(block)))
        # An object that turns a world is a part of the world's own fingerprint.
        readers = nodes_in(used_tree(block)) if isinstance(block, bpy.types.Material) else ()
        yield from (node.object for node in readers if getattr(node, "object", None) is not None)
    elif isinstance(block, bpy.types.GeometryNodeTree):
        yield from _of_group(block)
    elif isinstance(block, bpy.types.Collection):
        yield from [*block.objects, *block.children]
    elif isinstance(block, (bpy.types.Curve, bpy.types.Curves, bpy.types.ParticleSettings, bpy.types.Texture)):
        yield from _pointers(block)


def may_instance(block: bpy.types.ID, collection: bpy.types.Collection) -> bool:
    """True if a block that depends on a collection may show objects in it, as nodes and particles do."""
    if isinstance(block, bpy.types.Object):
        nodes = [modifier for modifier in block.modifiers if modifier.type == "NODES"]
        return any(value == collection for modifier in nodes for _, value in node_inputs(modifier))
    if isinstance(block, bpy.types.ParticleSettings):
        return block.render_type == "COLLECTION" and block.instance_collection == collection
    return isinstance(block, bpy.types.GeometryNodeTree)


def _of_object(obj: bpy.types.Object) -> Iterator[bpy.types.ID]:
    if obj.data is not None:
        yield obj.data
    yield from [slot.material for slot in obj.material_slots if slot.material is not None]
    if obj.parent is not None and obj.parent_type in {"ARMATURE", "LATTICE"}:  # Deforms as a modifier does.
        yield obj.parent
    for modifier in obj.modifiers:
        if modifier.show_render:
            yield from _of_modifier(modifier)


def _of_modifier(modifier: bpy.types.Modifier) -> Iterator[bpy.types.ID]:
    yield from _pointers(modifier)
    if modifier.type == "NODES":
        yield from [value for _, value in node_inputs(modifier) if isinstance(value, bpy.types.ID)]
    elif modifier.type == "PARTICLE_SYSTEM":
        yield modifier.particle_system.settings
    elif modifier.type == "UV_PROJECT":
        yield from [projector.object for projector in modifier.projectors if projector.object is not None]


def _of_group(tree: bpy.types.NodeTree) -> Iterator[bpy.types.ID | None]:
    for number, name in enumerate([node.name for node in tree.nodes]):
        if number % NODES_A_STEP == 0:
            yield None
        # By its name: an edit may have freed it.
        if (node := tree.nodes.get(name)) is not None:
            values = [getattr(socket, "default_value", None) for socket in node.inputs]
            yield from [*_pointers(node), *(value for value in values if isinstance(value, bpy.types.ID))]


def _pointers(struct: Any) -> list[bpy.types.ID]:
    """The data-blocks that the settings of any part of a file name."""
    found = [getattr(struct, name, None) for name in _pointer_names(struct.bl_rna.identifier)]
    return [block for block in found if isinstance(block, bpy.types.ID)]


@cache
def _pointer_names(kind: str) -> list[str]:
    properties = effective_properties(getattr(bpy.types, kind))
    return [prop.identifier for prop in properties if prop.type == "POINTER"]


def image_nodes(tree: bpy.types.NodeTree | None) -> Iterator[bpy.types.Node]:
    """The nodes with images of a material or world."""
    return (node for node in nodes_in(tree) if getattr(node, "image", None) is not None)


def nodes_in(tree: bpy.types.NodeTree | None) -> Iterator[bpy.types.Node]:
    """The nodes of a material or world, those of groups too."""
    for node in tree.nodes if tree else ():
        yield node
        if (inner := getattr(node, "node_tree", None)) is not None:
            yield from nodes_in(inner)
