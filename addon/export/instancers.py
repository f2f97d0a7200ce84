"""What objects instance: collections, and what geometry nodes and particles name, which need not be in the scene
itself. Of nodes and particle settings it is read what they name: what becomes of that only the evaluated scene knows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeAlias

import bpy

Block: TypeAlias = bpy.types.Object | bpy.types.Collection
NO_NUMBER = 2**31 - 1
"""Fills persistent ids."""


class Instancers:
    """Remembers what groups of nodes name, as many objects share them, and what objects show, as one may show a
    thousand times the same: for one look at the scene."""

    def __init__(self) -> None:
        self._by_group: dict[bpy.types.NodeTree, list[Block]] = {}
        self._reached: dict[bpy.types.Object, dict[bpy.types.Object, bool]] = {}
        self._inside: dict[bpy.types.Collection, list[tuple[bpy.types.Object, bool]]] = {}

    def named_by(self, obj: bpy.types.Object) -> list[Block]:
        """Objects and collections in an object's modifiers."""
        found: list[Any] = []
        for modifier in obj.modifiers:
            if modifier.type == "NODES" and modifier.node_group is not None:
                found += [value for _, value in node_inputs(modifier)]
                found += self._in_group(modifier.node_group)
            elif modifier.type == "PARTICLE_SYSTEM":
                found += _by_particles(modifier.particle_system.settings)
        return _blocks(found)

    def _in_group(self, group: bpy.types.NodeTree) -> list[Block]:
        if group not in self._by_group:
            self._by_group[group] = []  # A group cannot hold itself, but a damaged file may say so.
            found: list[Any] = []
            for node in group.nodes:
                found += [getattr(node, "object", None), getattr(node, "collection", None)]
                found += [getattr(socket, "default_value", None) for socket in node.inputs if not socket.is_linked]
                if (inner := getattr(node, "node_tree", None)) is not None:
                    found += self._in_group(inner)
            self._by_group[group] = _blocks(found)
        return self._by_group[group]

    def reached_from(self, obj: bpy.types.Object) -> dict[bpy.types.Object, bool]:
        """Objects that an object may instance in renders, also by way of others, and whether nodes or particles name
        them themselves: those are shown even where they are hidden, unlike what is in collections."""
        if obj not in self._reached:
            found = self._reached[obj] = {}
            todo = [obj]
            while todo:
                current = todo.pop()
                instanced = [current.instance_collection] if current.instance_type == "COLLECTION" else []
                for block in [*self.named_by(current), *_blocks(instanced)]:
                    is_named = isinstance(block, bpy.types.Object)
                    inside = [block] if is_named else [inner for inner, is_shown in self._objects_of(block) if is_shown]
                    todo += [inner for inner in inside if inner not in found]
                    found |= {inner: is_named or found.get(inner, False) for inner in inside}
        return self._reached[obj]

    def may_show_lights(self, obj: bpy.types.Object) -> bool:
        """Whether there are lights among what an object may instance."""
        return any(found.type == "LIGHT" for found in self.reached_from(obj))

    def renders(self, owner: bpy.types.Object, way: Sequence[int], light: bpy.types.Object) -> bool:
        """Whether renders too show an instance of a light that a view shows. `way` is its persistent id, which says,
        from the innermost to the outermost, which objects of instanced collections it is shown by; within nodes and
        particles it says nothing of that, so that it is enough there if there is such a way at all."""
        by = owner
        for place in reversed([number for number in way if number != NO_NUMBER]):
            if by.instance_type != "COLLECTION" or by.instance_collection is None:
                break
            by, is_shown = self._objects_of(by.instance_collection)[place]
            if not is_shown:
                return False
        if by == light:
            return True
        is_child = by.instance_type in {"VERTS", "FACES"} and light.parent == by
        return (is_child and not light.hide_render) or light in self.reached_from(by)

    def _objects_of(self, collection: bpy.types.Collection) -> list[tuple[bpy.types.Object, bool]]:
        if collection not in self._inside:
            self._inside[collection] = objects_in(collection)
        return self._inside[collection]


def objects_in(collection: bpy.types.Collection) -> list[tuple[bpy.types.Object, bool]]:
    """All objects of a collection that is instanced, in Blender's order, and whether renders show them there."""
    shown = set(_shown_in(collection))
    return [(obj, obj in shown and not obj.hide_render) for obj in collection.all_objects]


def _shown_in(collection: bpy.types.Collection) -> Iterator[bpy.types.Object]:
    """Objects that no collection hides from renders, on one way at least. An object is instanced however it is, or is
    not, in the scene."""
    if collection.hide_render:
        return
    yield from collection.objects
    for child in collection.children:
        yield from _shown_in(child)


def node_inputs(modifier: bpy.types.Modifier) -> list[tuple[str, Any]]:
    """What a modifier of geometry nodes hands to its group, by name."""
    if not hasattr(modifier, "properties"):  # As before Blender 5.2.
        return list(modifier.items())
    found = []
    for side in (modifier.properties.inputs, modifier.properties.outputs) if modifier.properties else ():
        for socket in side.bl_rna.properties.keys():
            parts = [(part, getattr(getattr(side, socket), part, None)) for part in ("value", "type", "attribute_name")]
            found += [(f"{socket} {part}", value) for part, value in parts]
    return found


def _by_particles(settings: bpy.types.ParticleSettings) -> list[Any]:
    shown = {"OBJECT": settings.instance_object, "COLLECTION": settings.instance_collection}
    return [shown.get(settings.render_type)]


def _blocks(values: list[Any]) -> list[Block]:
    """Those of some values that are objects or collections, each once."""
    return list(dict.fromkeys(value for value in values if isinstance(value, (bpy.types.Object, bpy.types.Collection))))
