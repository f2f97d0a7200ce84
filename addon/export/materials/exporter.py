"""Export of materials, each once."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from ..images import ImageExporter
from ..object_attributes import Surroundings
from .attribute_nodes import asked_of
from .closures import CLOSURES
from .function_nodes import SWITCHES
from .graph import used_tree
from .hair import HAIR_CLOSURES, HAIR_VALUES
from .translation import DEFAULT_SURFACE, NodeTables, Translation
from .values import VALUES
from .volumes import DEFAULT_VOLUME, VOLUMES

TABLES = NodeTables(CLOSURES | HAIR_CLOSURES | SWITCHES, VOLUMES, VALUES | HAIR_VALUES)

EMISSION = {"emission": ("strength", 0.0), "principled": ("emission_strength", 0.0)}
DEEPEST = 10_000
"""Calls within calls while a graph is followed, about seven for each node."""
TOO_DEEP = (RecursionError, MemoryError)
"""Exceptions of more calls than that. Blender makes the second of the first where it gives out one of its objects."""
NOT_UNDERSTOOD = (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError, *TOO_DEEP)
"""Exceptions of a graph that holds something unforeseen."""
FINE_STEPS = 0.1
"""Step rate up to which Cycles' march through media is right to some 1 %."""


class MaterialExporter:
    """Exports each material once and remembers its number."""

    def __init__(self, builder: Any, images: ImageExporter, surroundings: Surroundings | None = None):
        """Exports to a builder of a scene."""
        self.builder = builder
        self.images = images
        self.numbers: dict[str | None, int] = {}
        self.emissive: set[int] = set()
        """Numbers of those that may emit light."""
        self.filled: set[int] = set()
        """Numbers of those with a volume."""
        self.displacing: set[int] = set()
        """Numbers of those that displace meshes."""
        self.attributes: dict[int, dict[str, str]] = {}
        """Names of attributes that a material reads from meshes, with the material and node for messages, by the
        material's number."""
        self.of_objects: dict[int, set[str]] = {}
        """Names that a material asks each instance for, by the material's number; only where there are any."""
        self.surroundings = surroundings or Surroundings()

    def number(self, material: bpy.types.Material | None, object_name: str) -> int:
        """Number of a material; None is Cycles' grey default. `object_name` is for messages."""
        key = material.name_full if material else None
        if key not in self.numbers:
            self.numbers[key] = self._export(material, object_name)
        return self.numbers[key]

    def number_in_volume(self, material: bpy.types.Material | None, object_name: str) -> int:
        """Number of a material of a volume object; None is Cycles' default for those."""
        if material is not None:
            return self.number(material, object_name)
        key = DEFAULT_VOLUME["name"]
        if key not in self.numbers:
            number = self.numbers[key] = int(self.builder.add_material(json.dumps(DEFAULT_VOLUME)))
            self.filled.add(number)
            self.attributes[number] = {}
        return self.numbers[key]

    def world_volume(self, world: bpy.types.World) -> int | None:
        """Number of a material whose volume is that of a world; None if it has none."""
        translation = self._translation(None, "")
        translation.title, translation.owner = world.name, f"world '{world.name}'"
        try:
            with _deep_recursion():
                volume = translation.volume(used_tree(world))
            if not volume:
                return None
            description = {"name": world.name, "nodes": translation.nodes, "surface": None, **volume}
            if not _is_finite(description):
                translation.warn("a value of its volume is not a finite number; left out")
                return None
            return int(self.builder.add_material(json.dumps(description)))
        except NOT_UNDERSTOOD as error:
            translation.warn(f"the nodes of its volume are not understood ({error}); left out")
            return None

    def _translation(self, material: bpy.types.Material | None, object_name: str) -> Translation:
        return Translation(self.builder, self.images, TABLES, material, object_name, self.surroundings)

    def _export(self, material: bpy.types.Material | None, object_name: str) -> int:
        translation = self._translation(material, object_name)
        try:
            with _deep_recursion():
                description = translation.run()
            if not _is_finite(description):
                translation.warn("one of its values is not a finite number; taken as grey diffuse")
                description |= {"nodes": [DEFAULT_SURFACE], "surface": 0}
            number = self.builder.add_material(json.dumps(description))
        except NOT_UNDERSTOOD as error:
            translation.attributes.clear()
            reason = "too many follow each other" if isinstance(error, TOO_DEEP) else error
            translation.warn(f"its nodes are not understood ({reason}); taken as grey diffuse")
            description = {"name": translation.title, "nodes": [DEFAULT_SURFACE], "surface": 0}
            number = self.builder.add_material(json.dumps(description))
        self.attributes[number] = {
            name: f"material '{translation.title}', node '{node}'" for name, node in translation.attributes.items()
        }
        if translation.of_objects:
            self.of_objects[number] = translation.of_objects
        if _any(description, EMISSION):
            self.emissive.add(number)
        if "displacement" in description:
            self.displacing.add(number)
        if "volume" in description:
            self.filled.add(number)
            if translation.medium_varies and _marches(material):
                translation.warn(
                    "its volume varies, and Cycles of this Blender goes through it in coarse steps: there it lets more "
                    "light through; a Step Rate of 0.1 comes close"
                )
        return number


def _marches(material: bpy.types.Material | None) -> bool:
    """True if Cycles goes through a medium that varies in steps that are too long to be right."""
    cycles, scene = getattr(material, "cycles", None), getattr(bpy.context.scene, "cycles", None)
    if cycles is None or scene is None or not (bpy.app.version < (5, 0, 0) or scene.volume_biased):
        return False
    is_coarse = cycles.volume_step_rate * scene.volume_step_rate > FINE_STEPS
    return bool(is_coarse or getattr(cycles, "homogeneous_volume", False))


@contextmanager
def _deep_recursion() -> Iterator[None]:
    """Lets graphs be followed in which hundreds of nodes follow each other."""
    before = sys.getrecursionlimit()
    sys.setrecursionlimit(max(before, DEEPEST))
    try:
        yield
    finally:
        sys.setrecursionlimit(before)


def asked_attributes() -> set[str]:
    """Names that the materials of the open file ask meshes for."""
    trees = [block.node_tree for block in bpy.data.materials if block.node_tree] + list(bpy.data.node_groups)
    return {name for tree in trees for node in tree.nodes for name in asked_of(node)}


def _is_finite(description: dict[str, Any]) -> bool:
    try:
        json.dumps(description, allow_nan=False)
    except ValueError:
        return False
    return True


def _any(description: dict[str, Any], fields: dict[str, tuple[str, Any]]) -> bool:
    """True if a closure of a material has one of the fields at another value than the one without effect."""
    closures = (node for node in description["nodes"] if node["type"] in fields)
    return any(node[field] != nothing for node in closures for field, nothing in (fields[node["type"]],))
