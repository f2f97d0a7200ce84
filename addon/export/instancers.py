"""What objects instance: collections, and what geometry nodes and particles name, which need not be in the scene
itself. Of nodes and particle settings it is read what they name: what becomes of that only the evaluated scene knows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import bpy

Block: TypeAlias = bpy.types.Object | bpy.types.Collection
Way: TypeAlias = tuple[int, ...]
"""What is left of a persistent id, from the outermost to the innermost."""
NO_NUMBER = 2**31 - 1
"""Fills persistent ids."""


class _Named(NamedTuple):
    """What nodes name, and how."""

    blocks: list[Block]
    separates: set[bool]
    """Whether they make instances of each thing in a collection, or one of all of it; both where nobody can tell."""


class Instancers:
    """Remembers what groups of nodes name, as many objects share them, and what objects show, as one may show a
    thousand times the same: for one look at the scene."""

    def __init__(self) -> None:
        self._by_group: dict[bpy.types.NodeTree, _Named] = {}
        self._by_nodes: dict[bpy.types.Object, _Named] = {}
        self._by_particles: dict[bpy.types.Object, list[Block]] = {}
        self._reached: dict[bpy.types.Object, dict[bpy.types.Object, bool]] = {}
        self._inside: dict[bpy.types.Collection, list[tuple[bpy.types.Object, bool]]] = {}
        self._seen_inside: dict[Any, list[tuple[bpy.types.Object, bool]]] = {}
        """Of a collection and what instances it."""

    def named_by(self, obj: bpy.types.Object) -> list[Block]:
        """Objects and collections in an object's modifiers, in those too that are off."""
        return _blocks([block for modifier in obj.modifiers for block in self._in_modifier(modifier).blocks])

    def _nodes_of(self, obj: bpy.types.Object) -> _Named:
        """What an object's nodes name, in renders, and what those of named objects do: they may take in its geometry,
        also where it is hidden."""
        if obj not in self._by_nodes:
            found = self._by_nodes[obj] = _Named([], set())  # Objects may name each other.
            named = [self._in_modifier(modifier) for modifier in _rendered_modifiers(obj, "NODES")]
            blocks = [block for one in named for block in one.blocks]
            named += [self._nodes_of(block) for block in blocks if isinstance(block, bpy.types.Object)]
            found.blocks.extend(_blocks([block for one in named for block in one.blocks]))
            found.separates.update(*(one.separates for one in named))
        return self._by_nodes[obj]

    def _particles_of(self, obj: bpy.types.Object) -> list[Block]:
        if obj not in self._by_particles:
            named = [self._in_modifier(modifier) for modifier in _rendered_modifiers(obj, "PARTICLE_SYSTEM")]
            self._by_particles[obj] = _blocks([block for found in named for block in found.blocks])
        return self._by_particles[obj]

    def _in_modifier(self, modifier: bpy.types.Modifier) -> _Named:
        if modifier.type == "NODES" and modifier.node_group is not None:
            named = self._in_group(modifier.node_group)
            inputs = [value for _, value in node_inputs(modifier)]
            return _Named(_blocks([*inputs, *named.blocks]), named.separates)
        shown = _by_particles(modifier.particle_system.settings) if modifier.type == "PARTICLE_SYSTEM" else []
        return _Named(_blocks(shown), set())

    def _in_group(self, group: bpy.types.NodeTree) -> _Named:
        if group not in self._by_group:
            self._by_group[group] = _Named([], set())  # A group cannot hold itself, but a damaged file may say so.
            found: list[Any] = []
            separates: set[bool] = set()
            for node in group.nodes:
                found += [getattr(node, "object", None), getattr(node, "collection", None)]
                found += [getattr(socket, "default_value", None) for socket in node.inputs if not socket.is_linked]
                separates |= _separates(node)
                if (inner := getattr(node, "node_tree", None)) is not None:
                    named = self._in_group(inner)
                    found += named.blocks
                    separates |= named.separates
            self._by_group[group] = _Named(_blocks(found), separates)
        return self._by_group[group]

    def reached_from(self, obj: bpy.types.Object) -> dict[bpy.types.Object, bool]:
        """Objects that an object may instance in renders, also by way of others, and whether nodes or particles name
        them themselves: those are shown even where they are hidden, unlike what is in collections, but not what they
        instance."""
        if obj not in self._reached:
            found = self._reached[obj] = {}
            todo = [obj]
            while todo:
                for inner, is_named in self._shown_by(todo.pop()):
                    if inner not in found and not inner.hide_render:
                        todo.append(inner)
                    found[inner] = is_named or found.get(inner, False)
        return self._reached[obj]

    def placed_by(self, obj: bpy.types.Object) -> set[bpy.types.Object]:
        """Objects that an object itself instances, or would if nothing were hidden."""
        found = set(obj.children) if obj.instance_type in {"VERTS", "FACES"} else set()
        for block in _blocks([_instanced_by(obj), *self.named_by(obj)]):
            found |= {block} if isinstance(block, bpy.types.Object) else set(block.all_objects)
        return found

    def _shown_by(self, obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, bool]]:
        """What an object itself may instance in renders, and whether that is shown even where it is hidden."""
        if (instanced := _instanced_by(obj)) is not None:
            yield from self._shown_in(instanced)
        for block in [*self._nodes_of(obj).blocks, *self._particles_of(obj)]:
            if isinstance(block, bpy.types.Object):
                yield block, True
            else:
                yield from self._shown_in(block)
        if True in self._nodes_of(obj).separates:
            for block in self._nodes_of(obj).blocks:
                yield from ((inner, True) for inner in getattr(block, "objects", ()))

    def _shown_in(self, collection: bpy.types.Collection) -> Iterator[tuple[bpy.types.Object, bool]]:
        yield from ((obj, False) for obj, is_shown in self._objects_of(collection) if is_shown)

    def may_show_lights(self, obj: bpy.types.Object) -> bool:
        """Whether there are lights among what an object may instance."""
        return any(found.type == "LIGHT" for found in self.reached_from(obj))

    def renders(self, owner: bpy.types.Object, way: Sequence[int], light: bpy.types.Object) -> bool:
        """Whether renders too show an instance of a light that a view shows. `way` is its persistent id, which says,
        from the innermost to the outermost, by which objects it is shown. Of particles it does not, nor of nodes that
        take a collection apart: it is enough there that they show the light at all."""
        return self._leads(owner, tuple(number for number in reversed(way) if number != NO_NUMBER), light)

    def _leads(self, by: bpy.types.Object, way: Way, light: bpy.types.Object) -> bool:
        """Whether renders show a light by what an object instances."""
        if not way:
            return False
        if (instanced := _instanced_by(by)) is not None:
            return self._shows_one_of(self._objects_of(instanced), way[0], way[1:], light)
        if by.instance_type in {"VERTS", "FACES"} and any(
            not child.hide_render and self._shows(child, way[1:], light) for child in by.children
        ):
            return True
        return self._nodes_lead(by, way, light) or light in self._shown_by_particles(by)

    def _nodes_lead(self, by: bpy.types.Object, way: Way, light: bpy.types.Object) -> bool:
        """The same of nodes, which begin a way with a number for each time that they instance instances."""
        ways = [way[begin:] for begin in range(1, len(way) + 1)]
        return any(self._block_shows(block, rest, light, by) for block in self._nodes_of(by).blocks for rest in ways)

    def _block_shows(self, block: Block, way: Way, light: bpy.types.Object, by: bpy.types.Object) -> bool:
        """Whether an instance by nodes of an object or a collection is of a light, or shows it."""
        if isinstance(block, bpy.types.Object):
            return self._shows(block, way, light)
        separates = self._nodes_of(by).separates
        if True in separates:
            if any(self._shows(obj, way, light) for obj in block.objects):
                return True
            if any(self._whole_shows(child, way, light, by) for child in block.children):
                return True
        return (False in separates or not separates) and self._whole_shows(block, way, light, by)

    def _whole_shows(
        self, collection: bpy.types.Collection, way: Way, light: bpy.types.Object, by: bpy.types.Object
    ) -> bool:
        """Of a collection that nodes instance as one. Each object that views show there has two numbers: of itself, and
        of what it instances."""
        if not way:
            return False
        seen = self._seen_in(collection, by)
        is_itself = way[0] % 2 == 0
        return is_itself == (len(way) == 1) and self._shows_one_of(seen, way[0] // 2, way[1:], light)

    def _shows_one_of(
        self, objects: list[tuple[bpy.types.Object, bool]], place: int, way: Way, light: bpy.types.Object
    ) -> bool:
        """Whether the object in a place shows the light, and renders show that."""
        if not 0 <= place < len(objects):
            return False
        obj, is_shown = objects[place]
        return is_shown and self._shows(obj, way, light)

    def _shows(self, obj: bpy.types.Object, way: Way, light: bpy.types.Object) -> bool:
        """Whether an instance of an object is the light, or shows it. What is hidden instances nothing."""
        return not obj.hide_render and self._leads(obj, way, light) if way else obj == light

    def _shown_by_particles(self, by: bpy.types.Object) -> list[bpy.types.Object]:
        blocks = self._particles_of(by)
        collections = [block for block in blocks if isinstance(block, bpy.types.Collection)]
        inside = [obj for collection in collections for obj, _ in self._shown_in(collection)]
        return [*inside, *(block for block in blocks if isinstance(block, bpy.types.Object))]

    def _objects_of(self, collection: bpy.types.Collection) -> list[tuple[bpy.types.Object, bool]]:
        if collection not in self._inside:
            self._inside[collection] = objects_in(collection)
        return self._inside[collection]

    def _seen_in(self, collection: bpy.types.Collection, by: bpy.types.Object) -> list[tuple[bpy.types.Object, bool]]:
        """Those of them that views show where an object instances them, which does not show itself."""
        if (collection, by) not in self._seen_inside:
            seen = set(_not_hidden(collection, "hide_viewport")) - {by}
            inside = self._objects_of(collection)
            self._seen_inside[collection, by] = [(obj, is_shown) for obj, is_shown in inside if obj in seen]
        return self._seen_inside[collection, by]


def objects_in(collection: bpy.types.Collection) -> list[tuple[bpy.types.Object, bool]]:
    """All objects of a collection that is instanced, in Blender's order, and whether renders show them there."""
    shown = set(_not_hidden(collection, "hide_render"))
    return [(obj, obj in shown) for obj in collection.all_objects]


def _not_hidden(collection: bpy.types.Collection, hiding: str) -> Iterator[bpy.types.Object]:
    """Objects that a property hides neither themselves nor by collections, on one way at least. An object is instanced
    however it is, or is not, in the scene."""
    if getattr(collection, hiding):
        return
    yield from (obj for obj in collection.objects if not getattr(obj, hiding))
    for child in collection.children:
        yield from _not_hidden(child, hiding)


def _rendered_modifiers(obj: bpy.types.Object, kind: str) -> list[bpy.types.Modifier]:
    return [modifier for modifier in obj.modifiers if modifier.type == kind and modifier.show_render]


def _instanced_by(obj: bpy.types.Object) -> bpy.types.Collection | None:
    return obj.instance_collection if obj.instance_type == "COLLECTION" else None


def _separates(node: bpy.types.Node) -> set[bool]:
    if node.bl_idname != "GeometryNodeCollectionInfo":
        return set()
    socket = node.inputs["Separate Children"]
    return {True, False} if socket.is_linked else {socket.default_value}


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
