"""What objects instance by geometry nodes and particles, which need not be in the scene itself. Read from what nodes
and particle settings name: what becomes of that only the evaluated scene knows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, TypeAlias

import bpy

Block: TypeAlias = bpy.types.Object | bpy.types.Collection


class Instancers:
    """Remembers what groups of nodes name, as many objects share them, and what objects show, as one may show a
    thousand times the same: for one look at the scene."""

    def __init__(self) -> None:
        self._by_group: dict[bpy.types.NodeTree, list[Block]] = {}
        self._named: dict[bpy.types.Object, set[bpy.types.Object]] = {}

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

    def reached_from(self, obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, bool]]:
        """Objects that an object may instance, also by way of others, and whether nodes or particles name them
        themselves: those are shown even where they are hidden, unlike what is in collections."""
        todo, seen = [obj], {obj}
        while todo:
            current = todo.pop()
            instanced = [current.instance_collection] if current.instance_type == "COLLECTION" else []
            for block in [*self.named_by(current), *_blocks(instanced)]:
                is_named = isinstance(block, bpy.types.Object)
                for found in [block] if is_named else block.all_objects:
                    yield found, is_named
                    if found not in seen:
                        seen.add(found)
                        todo.append(found)

    def may_show_lights(self, obj: bpy.types.Object) -> bool:
        """Whether there are lights among what an object may instance."""
        return any(found.type == "LIGHT" for found, _ in self.reached_from(obj))

    def names(self, obj: bpy.types.Object, light: bpy.types.Object) -> bool:
        """Whether an object shows a light by naming it, so that it does not matter whether the light is hidden."""
        if obj not in self._named:
            self._named[obj] = {found for found, is_named in self.reached_from(obj) if is_named}
        return light in self._named[obj]


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
