"""Lights that a picture of a scene can have, and the collections that they are in."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import bpy

from ..core.rows import GROUP, LIGHT
from .instancers import Instancers
from .lights import is_portal, name_of

Path = tuple[bpy.types.Collection, ...]


@dataclass(frozen=True)
class Line:
    """A light object, or a collection with lights in it."""

    block: bpy.types.ID
    kind: str
    depth: int
    """Number of collections around it."""
    groups: tuple[str, ...] = ()
    """Names (`name_of`) of all collections that a light is in, also through others and through instances."""
    is_named: bool = False
    """True if geometry nodes or particles may instance the light itself, which show it even where it is hidden."""


def light_tree(scene: bpy.types.Scene) -> list[Line]:
    """Every light and every collection with lights once, each collection before what is in it. Lights of instanced
    collections count, under the collection that is instanced, and so do those that geometry nodes and particles
    instance; where nothing else has them, below the collection of what instances them. Portals do not, they emit
    nothing."""
    walk = _Walk(scene.collection)
    walk.enter_instanced()
    return list(walk.lines(scene.collection, 0))


def light_objects(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """Light objects of the light tree, each of which has a row."""
    return [line.block for line in light_tree(scene) if line.kind == LIGHT]


class _Walk:
    """Walk through all collections, which notes where lights are."""

    def __init__(self, top: bpy.types.Collection):
        """Enters the collection `top` and all below it."""
        self.paths: dict[bpy.types.Object, list[Path]] = {}
        self.inside: dict[bpy.types.Collection, dict[bpy.types.ID, None]] = {}
        self.with_lights: set[bpy.types.Collection] = set()
        self.entered: set[Path] = set()
        self.listed: set[bpy.types.ID] = set()
        self.seen: set[bpy.types.Object] = set()
        self.modified: deque[tuple[bpy.types.Object, Path]] = deque()
        """Objects with modifiers, and where they were met first."""
        self.named: set[bpy.types.Object] = set()
        self.top = top
        self.enter(top, ())

    def enter(self, collection: bpy.types.Collection, path: Path) -> None:
        """Finds the lights below a collection. `path` has the collections around it, itself included."""
        inside = self.inside.setdefault(collection, {})
        for child in collection.children:
            self._enter_child(inside, child, path)
        for obj in collection.objects:
            self._enter_object(inside, obj, path)

    def _enter_object(self, inside: dict[bpy.types.ID, None], obj: bpy.types.Object, path: Path) -> None:
        if is_light(obj):
            self.paths.setdefault(obj, []).append(path)
            self.with_lights.update(path)
            inside[obj] = None
        elif obj.instance_type == "COLLECTION" and obj.instance_collection:
            self._enter_child(inside, obj.instance_collection, path)
        elif len(obj.modifiers) and obj not in self.seen:
            self.modified.append((obj, path))
        self.seen.add(obj)

    def _enter_child(self, inside: dict[bpy.types.ID, None], child: bpy.types.Collection, path: Path) -> None:
        below = (*path, child)
        if child in path or below in self.entered:  # An instance inside of what it instances would never end.
            return
        self.entered.add(below)
        inside[child] = None
        self.enter(child, below)

    def enter_instanced(self) -> None:
        """Finds lights that are in no collection so far, and those that modifiers name."""
        instancers = Instancers()
        while self.modified:
            obj, path = self.modified.popleft()
            inside = self.inside[path[-1] if path else self.top]
            for block in instancers.named_by(obj):
                if isinstance(block, bpy.types.Object):
                    self.named.add(block)
                    if block not in self.seen:
                        self._enter_object(inside, block, path)
                elif block not in self.inside:
                    self._enter_child(inside, block, path)

    def lines(self, collection: bpy.types.Collection, depth: int) -> Iterator[Line]:
        """Lines of the lights and collections in a collection, collections first."""
        inside = [block for block in self.inside[collection] if block not in self.listed]
        for child in inside:
            if isinstance(child, bpy.types.Collection) and child in self.with_lights and child not in self.listed:
                self.listed.add(child)
                yield Line(child, GROUP, depth)
                yield from self.lines(child, depth + 1)
        lights = (block for block in inside if isinstance(block, bpy.types.Object))
        for light in sorted(lights, key=lambda light: light.name.casefold()):
            if light not in self.listed:
                self.listed.add(light)
                names = dict.fromkeys(name_of(group) for path in self.paths[light] for group in path)
                yield Line(light, LIGHT, depth, tuple(names), light in self.named)


def is_light(obj: bpy.types.Object) -> bool:
    """True if an object emits as a light."""
    return obj.type == "LIGHT" and not is_portal(obj.data)
