"""Attributes that geometry nodes give their instances. Python can read them from Blender 4.5 on. An instance's way
through nested instances is its persistent id; Blender numbers it in `make_duplis_geometry_set_impl`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from .attributes import attribute_colors
from .instancers import NO_NUMBER, instanced_by, objects_in
from .object_attributes import Rgba

SHAPES = {
    "mesh": {"MESH"},
    "volume": {"VOLUME"},
    "curves": {"CURVE", "FONT", "CURVES"},
    "pointcloud": {"POINTCLOUD"},
    "grease_pencil": {"GREASEPENCIL"},
}
"""Kinds of geometry, and the types of objects whose own geometry it is, which is no instance of theirs."""
OF_CLOUD = {"position"}
"""Attributes of points that stand for instances, which the instances themselves have not."""


class _Level:
    """Instances of one geometry."""

    def __init__(self, geometry: Any, own: str):
        """Reads the instances of a geometry; `own` is the type of its object where it is no instance itself."""
        self.geometry = geometry
        """Owner of what is read here."""
        self.shapes = sum(getattr(geometry, shape) is not None for shape, types in SHAPES.items() if own not in types)
        self.cloud = geometry.instances_pointcloud()
        """Instances as points; None if there are none."""
        self.references = geometry.instance_references()
        self.reference_of: Sequence[int] = ()
        self.places: dict[int, int] = {}
        """Index of each instance by its number in persistent ids."""
        self.colors: dict[str, np.ndarray | None] = {}
        if self.cloud is None:
            return
        found = self.cloud.attributes
        self.reference_of = [each.value for each in found[".reference_index"].data]
        numbers = [each.value for each in found["id"].data] if "id" in found else range(len(self.reference_of))
        for place, number in enumerate(numbers):
            self.places.setdefault(number, place)  # Blender gives new numbers to those that come again.

    def color(self, name: str, place: int) -> Rgba | None:
        """An attribute of an instance, None where it has none."""
        if name not in self.colors:
            attribute = self.cloud.attributes.get(name) if name not in OF_CLOUD else None
            is_read = attribute is not None and attribute.data_type != "QUATERNION"
            self.colors[name] = attribute_colors(attribute, name) if is_read else None
        colors = self.colors[name]
        if colors is None:
            return None
        red, green, blue, alpha = colors[place].tolist()
        return red, green, blue, alpha


class UnknownInstanceError(Exception):
    """The way to an instance cannot be followed."""


class InstanceAttributes:
    """Attributes of instances, read once for each object that makes them. Kept for one look at a depsgraph."""

    def __init__(self) -> None:
        """Starts with nothing read."""
        self._of_objects: dict[int, _Level] = {}
        self._inside: dict[tuple[_Level, int], _Level] = {}

    def find(self, instance: bpy.types.DepsgraphObjectInstance, name: str) -> Rgba | None:
        """An attribute that nodes give an instance, the innermost of that name; None if none do. Raises
        UnknownInstanceError where that cannot be known."""
        owner = instance.parent
        if owner is None or not instance.is_instance:
            return None
        path = [number for number in reversed(instance.persistent_id) if number != NO_NUMBER]
        for level, place in reversed(self._through_object(owner, path)):
            if (color := level.color(name, place)) is not None:
                return color
        return None

    def _through_object(self, obj: bpy.types.Object, path: list[int]) -> list[tuple[_Level, int]]:
        """Levels on a way that begins at an object that instances."""
        if any(modifier.type == "NODES" for modifier in obj.modifiers):
            if not hasattr(obj, "evaluated_geometry"):
                raise UnknownInstanceError
            uid = obj.original.session_uid
            if uid not in self._of_objects:
                self._of_objects[uid] = _Level(obj.evaluated_geometry(), obj.type)
            level = self._of_objects[uid]
            if level.shapes or level.cloud is not None:
                return self._through_level(level, obj, path)
        if (collection := instanced_by(obj)) is not None:
            return self._through_place([inner for inner, _ in objects_in(collection)], path[0], path[1:])
        # Particles have one number, and children on points and faces two, which do not name the child.
        if len(path) > (2 if obj.instance_type in {"VERTS", "FACES"} else 1):
            raise UnknownInstanceError
        return []

    def _through_level(self, level: _Level, by: bpy.types.Object, path: list[int]) -> list[tuple[_Level, int]]:
        """Levels on a way that begins at the instances of a geometry."""
        if level.shapes:
            if len(path) == 1:
                return []
            path = path[1:]
        if not path or path[0] not in level.places:
            raise UnknownInstanceError
        place = level.places[path[0]]
        here, rest = [(level, place)], path[1:]
        number = level.reference_of[place]
        reference = level.references[number]
        if isinstance(reference, bpy.types.Object):
            return here + (self._through_object(reference, rest) if rest else [])
        if isinstance(reference, bpy.types.Collection):
            inside = [obj for obj, is_shown in objects_in(reference) if is_shown and obj.original != by.original]
            return here + self._through_place(inside, rest[0] // 2 if rest else -1, rest[1:])
        if (level, number) not in self._inside:
            self._inside[level, number] = _Level(reference, "")
        return here + self._through_level(self._inside[level, number], by, rest)

    def _through_place(self, objects: list[bpy.types.Object], place: int, rest: list[int]) -> list[tuple[_Level, int]]:
        """Levels on a way through an object of a collection."""
        if not 0 <= place < len(objects):
            raise UnknownInstanceError
        return self._through_object(objects[place], rest) if rest else []
