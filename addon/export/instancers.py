"""Instances that objects make: of collections, and of data-blocks that nodes and particles name. The latter need not
be in the scene. Only names are read here: how nodes and particles use them, only the evaluated scene tells."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, NamedTuple, TypeAlias

import bpy

Block: TypeAlias = bpy.types.Object | bpy.types.Collection
InstancePath: TypeAlias = tuple[int, ...]
"""Remaining part of a persistent id, from the outermost to the innermost."""
Shown: TypeAlias = Callable[[bpy.types.Object], bool]
"""Returns True if renders show an object in some place, hidden neither itself nor by collections."""
INSTANCE_BY = ("OBJECT", "NODETREE", "PARTICLE")
"""Types of data-blocks that can name an instanced one."""
NO_NUMBER = 2**31 - 1
"""Fills persistent ids."""


class _Named(NamedTuple):
    """Data-blocks that nodes name, and how."""

    blocks: list[Block]
    separates: set[bool]
    """True if they instance each object of a collection, False if the whole collection; both if that is unknown."""


class Instancers:
    """Names in groups of nodes, which many objects share, and objects that others show, which may be a thousand times
    the same. Kept for one look at the scene."""

    def __init__(self) -> None:
        """Starts with nothing known."""
        self._by_group: dict[bpy.types.NodeTree, _Named] = {}
        self._by_nodes: dict[bpy.types.Object, _Named] = {}
        self._by_particles: dict[bpy.types.Object, list[Block]] = {}
        self._rendered: dict[tuple[bpy.types.Object, bpy.types.Object, InstancePath], bool] = {}
        self._reached: dict[bpy.types.Object, dict[bpy.types.Object, bool]] = {}
        self._inside: dict[bpy.types.Collection, list[tuple[bpy.types.Object, bool]]] = {}
        self._seen_inside: dict[Any, list[tuple[bpy.types.Object, bool]]] = {}
        """Objects inside of a collection, by the collection and its instancer."""

    def named_by(self, obj: bpy.types.Object) -> list[Block]:
        """Objects and collections in an object's modifiers, in those too that are off."""
        return _blocks([block for modifier in obj.modifiers for block in self._in_modifier(modifier).blocks])

    def _nodes_of(self, obj: bpy.types.Object) -> _Named:
        """Data-blocks that an object's nodes name, in renders, together with those of named objects: they may take in
        its geometry, also where it is hidden."""
        if obj not in self._by_nodes:
            collected = self._by_nodes[obj] = _Named([], set())  # Objects may name each other.
            named = [self._in_modifier(modifier) for modifier in _rendered_modifiers(obj, "NODES")]
            blocks = [block for one in named for block in one.blocks]
            named += [self._nodes_of(block) for block in blocks if isinstance(block, bpy.types.Object)]
            collected.blocks.extend(_blocks([block for one in named for block in one.blocks]))
            collected.separates.update(*(one.separates for one in named))
        return self._by_nodes[obj]

    def _particles_of(self, obj: bpy.types.Object) -> list[Block]:
        if obj not in self._by_particles:
            named = [self._in_modifier(modifier) for modifier in _rendered_modifiers(obj, "PARTICLE_SYSTEM")]
            self._by_particles[obj] = _blocks([block for inner in named for block in inner.blocks])
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
            values: list[Any] = []
            separates: set[bool] = set()
            for node in group.nodes:
                values += [getattr(node, "object", None), getattr(node, "collection", None)]
                values += [getattr(socket, "default_value", None) for socket in node.inputs if not socket.is_linked]
                separates |= _separates(node)
                if (inner := getattr(node, "node_tree", None)) is not None:
                    named = self._in_group(inner)
                    values += named.blocks
                    separates |= named.separates
            self._by_group[group] = _Named(_blocks(values), separates)
        return self._by_group[group]

    def reached_from(self, obj: bpy.types.Object) -> dict[bpy.types.Object, bool]:
        """Objects that an object may instance in renders, also through others, each with True if nodes or particles
        name it. Named objects are shown even where they are hidden, unlike those in collections, but not what they
        instance."""
        if obj not in self._reached:
            reached = self._reached[obj] = {}
            todo = [obj]
            while todo:
                for inner, is_named in self._shown_by(todo.pop()):
                    if inner not in reached and not inner.hide_render:
                        todo.append(inner)
                    reached[inner] = is_named or reached.get(inner, False)
        return self._reached[obj]

    def placed_by(self, obj: bpy.types.Object) -> set[bpy.types.Object]:
        """Objects that an object itself instances, or would if nothing were hidden."""
        children = set(obj.children_recursive) if obj.instance_type in {"VERTS", "FACES"} else set()
        return children.union(_objects_of(_blocks([instanced_by(obj)])), *map(self.placed_by_modifier, obj.modifiers))

    def placed_by_modifier(self, modifier: bpy.types.Modifier) -> set[bpy.types.Object]:
        """Objects that a modifier may instance, also one that is off."""
        return _objects_of(self._in_modifier(modifier).blocks)

    def _shown_by(self, obj: bpy.types.Object) -> Iterator[tuple[bpy.types.Object, bool]]:
        """Objects that an object itself may instance in renders, each with True if it is shown even where hidden."""
        if (instanced := instanced_by(obj)) is not None:
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
        """True if there are lights among the objects that an object may instance."""
        return any(inner.type == "LIGHT" for inner in self.reached_from(obj))

    def renders(
        self, owner: bpy.types.Object, path: Sequence[int], light: bpy.types.Object, is_rendered: Shown
    ) -> bool:
        """True if renders too show an instance of a light that a view shows.

        `path` is its persistent id: from the innermost to the outermost, the objects by which it is shown. For
        particles, nodes that take a collection apart, and nodes that are not known here, it does not say so: there it
        is enough that they show the light at all. `is_rendered` is called with the scene's own objects."""
        numbers = tuple(number for number in reversed(path) if number != NO_NUMBER)
        # Which of their instances it is says nothing of points and faces, of which there may be thousands.
        key = owner, light, numbers if instanced_by(owner) else numbers[1:]
        if key not in self._rendered:
            shown = list(self._instances(owner, numbers, light, is_rendered))
            self._rendered[key] = any(shown) if shown else light in self.reached_from(owner)
        return self._rendered[key]

    def _instances(
        self, by: bpy.types.Object, path: InstancePath, light: bpy.types.Object, is_here: Shown
    ) -> Iterator[bool]:
        """Yields True if renders show the light, for each thing that an object instances and the path may lead through.
        `is_here` tells what renders show of the scene or collection that the object itself is shown in."""
        if not path:
            return
        if (instanced := instanced_by(by)) is not None:
            yield from self._in_place(self._objects_of(instanced), path[0], path[1:], light)
            return
        for child in by.children_recursive if by.instance_type in {"VERTS", "FACES"} else ():
            yield from (is_shown and is_here(child) for is_shown in self._along(child, path[1:], light, is_here))
        # Nodes begin a path with a number for each time that they instance instances.
        for block in self._nodes_of(by).blocks:
            for begin in range(1, len(path) + 1):
                yield from self._in_block(block, path[begin:], light, by, is_here)
        if light in self._shown_by_particles(by):
            yield True

    def _in_block(
        self, block: Block, path: InstancePath, light: bpy.types.Object, by: bpy.types.Object, is_here: Shown
    ) -> Iterator[bool]:
        """Yields like `_instances`, for data-blocks that nodes name."""
        if isinstance(block, bpy.types.Object):
            yield from self._along(block, path, light, is_here)
            return
        separates = self._nodes_of(by).separates or {False}
        if True in separates:
            for obj in block.objects:
                yield from self._along(obj, path, light, is_here)
        for whole in [*block.children] * (True in separates) + [block] * (False in separates):
            yield from self._in_whole(whole, path, light, by)

    def _in_whole(
        self, collection: bpy.types.Collection, path: InstancePath, light: bpy.types.Object, by: bpy.types.Object
    ) -> Iterator[bool]:
        """Yields like `_instances`, for a collection that nodes instance as one. Each object that views show there has
        two numbers: its own, and one for its instances."""
        if path and (path[0] % 2 == 0) == (len(path) == 1):
            yield from self._in_place(self._seen_in(collection, by), path[0] // 2, path[1:], light)

    def _in_place(
        self, objects: list[tuple[bpy.types.Object, bool]], place: int, path: InstancePath, light: bpy.types.Object
    ) -> Iterator[bool]:
        """Yields like `_instances`, for the object in a place."""

        def is_here(obj: bpy.types.Object) -> bool:
            return (obj, True) in objects

        for obj, is_rendered in objects[place : place + 1] if place >= 0 else ():
            yield from (is_shown and is_rendered for is_shown in self._along(obj, path, light, is_here))

    def _along(
        self, obj: bpy.types.Object, path: InstancePath, light: bpy.types.Object, is_here: Shown
    ) -> Iterator[bool]:
        """Yields like `_instances`, for an instance of an object, which may be the light itself. A hidden one instances
        nothing."""
        if path:
            yield from (is_shown and not obj.hide_render for is_shown in self._instances(obj, path, light, is_here))
        elif obj == light:
            yield True

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
        """Objects of a collection that views show where an object instances it, without that object itself."""
        if (collection, by) not in self._seen_inside:
            shown = set(_not_hidden(collection, "hide_viewport")) - {by}
            inside = self._objects_of(collection)
            self._seen_inside[collection, by] = [(obj, is_shown) for obj, is_shown in inside if obj in shown]
        return self._seen_inside[collection, by]


def may_be_instanced(lights: Collection[bpy.types.Object]) -> bool:
    """True if something may instance one of a file's lights, because it uses the light or a collection around it. The
    user may be a mere rig, but no look at each of a hundred thousand objects and instances is needed."""
    if any(light.instance_type != "NONE" or _is_on_points(light) for light in lights):
        return True
    users = bpy.data.user_map(subset={*lights, *bpy.data.collections}, value_types={"COLLECTION", *INSTANCE_BY})
    todo: list[bpy.types.ID] = list(lights)
    visited = set(todo)
    while todo:
        for user in users.get(todo.pop(), set()) - visited:
            if not isinstance(user, bpy.types.Collection):
                return True
            visited.add(user)
            todo.append(user)
    return False


def _is_on_points(obj: bpy.types.Object) -> bool:
    """True if an object's parent instances it on its points or faces."""
    parent = obj.parent
    while parent is not None and parent.instance_type not in {"VERTS", "FACES"}:
        parent = parent.parent
    return parent is not None


def objects_in(collection: bpy.types.Collection) -> list[tuple[bpy.types.Object, bool]]:
    """All objects of a collection that is instanced, in Blender's order, each with True if renders show it there."""
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


def instanced_by(obj: bpy.types.Object) -> bpy.types.Collection | None:
    """Collection that an object instances."""
    return obj.instance_collection if obj.instance_type == "COLLECTION" else None


def _separates(node: bpy.types.Node) -> set[bool]:
    if node.bl_idname != "GeometryNodeCollectionInfo":
        return set()
    socket = node.inputs["Separate Children"]
    return {True, False} if socket.is_linked else {socket.default_value}


def node_inputs(modifier: bpy.types.Modifier) -> list[tuple[str, Any]]:
    """Inputs that a modifier of geometry nodes passes to its group, by name."""
    if not hasattr(modifier, "properties"):  # As before Blender 5.2.
        return list(modifier.items())
    inputs = []
    for side in (modifier.properties.inputs, modifier.properties.outputs) if modifier.properties else ():
        for socket in side.bl_rna.properties.keys():
            parts = [
                (attribute, getattr(getattr(side, socket), attribute, None))
                for attribute in ("value", "type", "attribute_name")
            ]
            inputs += [(f"{socket} {attribute}", value) for attribute, value in parts]
    return inputs


def _by_particles(settings: bpy.types.ParticleSettings) -> list[Any]:
    shown = {"OBJECT": settings.instance_object, "COLLECTION": settings.instance_collection}
    return [shown.get(settings.render_type)]


def _objects_of(blocks: list[Block]) -> set[bpy.types.Object]:
    """Objects, and those in collections."""
    inside = (block.all_objects if isinstance(block, bpy.types.Collection) else [block] for block in blocks)
    return {obj for objects in inside for obj in objects}


def _blocks(values: list[Any]) -> list[Block]:
    """Values that are objects or collections, each once."""
    return list(dict.fromkeys(value for value in values if isinstance(value, (bpy.types.Object, bpy.types.Collection))))
