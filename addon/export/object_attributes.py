"""Attributes that materials ask whole objects, instancers and view layers for: custom properties, and any property of
theirs with up to four numbers. Looked up as in Blender's `BKE_object_dupli_find_rgba_attribute`."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import isfinite
from typing import Any, TypeAlias

import bpy
from mathutils import Matrix

from ..core.random_number import random_of_number
from .camera import WatchedCamera

Rgba: TypeAlias = tuple[float, float, float, float]

OF_INSTANCER = {"generated": "\tgenerated of instancer", "uv": "\tUV of instancer"}
"""Names of an instance's coordinates on its instancer."""
OF_ARRAY = re.compile(r"\[\d+\]$")
MATRIX, MATRIX_INVERSE = "\tworld from object ", "\tobject from world "
"""How the names of the rows of an instance's transform and its inverse begin: the axis follows."""
PARTICLE = "\tparticle "
"""How the names of what the node Particle Info tells begin: its output follows."""
NO_VALUE: Rgba = (0.0, 0.0, 0.0, 0.0)
Given: TypeAlias = Callable[[bpy.types.DepsgraphObjectInstance, str], Rgba | None]
"""Finds an attribute that nodes give an instance."""


@dataclass(frozen=True)
class Surroundings:
    """Answers to what materials ask of all that is around the objects."""

    value_of_layer: Callable[[str], Rgba] = lambda _name: NO_VALUE
    """Finds an attribute of the view layer, or else of its scene or world."""
    world_from_camera: Callable[[], Matrix] = Matrix
    """Finds the transform of Cycles' camera, which has no scale and looks along +z."""


def surroundings_of(depsgraph: bpy.types.Depsgraph, camera: WatchedCamera) -> Surroundings:
    """Surroundings of what a depsgraph renders with a camera."""
    scene, layer = depsgraph.scene_eval, depsgraph.view_layer_eval

    def of_layer(name: str) -> Rgba:
        if name.startswith("camera"):  # A path to a property, such as `camera.location`.
            camera.note_use()
        return value_of_layer(scene, layer, name)

    def world_from_camera() -> Matrix:
        return camera.matrix_world.normalized() @ Matrix.Diagonal((1.0, 1.0, -1.0, 1.0))

    return Surroundings(of_layer, world_from_camera)


def object_name(kind: str, name: str) -> str:
    """Name under which a material asks an object, or where `kind` is INSTANCER its instancer, for an attribute."""
    return f"\t{kind}\t{name}"


def values_of_instance(
    instance: bpy.types.DepsgraphObjectInstance, names: Iterable[str], given: Given
) -> list[tuple[str, Rgba]]:
    """Values of an instance for the names that materials ask it for. `given` finds what nodes give it."""
    return [(name, _finite(_value(instance, name, given))) for name in sorted(names)]


def value_of_layer(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, name: str) -> Rgba:
    """Value of an attribute of a view layer, or else of its scene or world."""
    return _finite(_first((layer, scene, scene.world), name))


def _value(instance: bpy.types.DepsgraphObjectInstance, name: str, given: Given) -> Rgba:
    if name == OF_INSTANCER["generated"]:
        # Cycles' own scale of what Blender gives.
        x, y, z = [0.5 * value - 0.5 for value in instance.orco] if instance.is_instance else [0.0] * 3
        return x, y, z, 1.0
    if name == OF_INSTANCER["uv"]:
        u, v = list(instance.uv) if instance.is_instance else [0.0] * 2
        return u, v, 0.0, 1.0
    if name.startswith((MATRIX, MATRIX_INVERSE)):
        matrix = instance.matrix_world if name.startswith(MATRIX) else instance.matrix_world.inverted_safe()
        row = matrix["xyz".index(name[-1])]
        return row[0], row[1], row[2], row[3]
    if name.startswith(PARTICLE):
        return _of_particle(instance, name.removeprefix(PARTICLE))
    _, kind, asked = name.split("\t", 2)
    if kind == "INSTANCER" and instance.is_instance:
        return _of_instancer(instance, asked, given)
    return _first((instance.object, instance.object.data), asked)


def _of_instancer(instance: bpy.types.DepsgraphObjectInstance, asked: str, given: Given) -> Rgba:
    particles = instance.particle_system
    if particles is not None and (value := find_rgba(particles.settings, asked)) is not None:
        return value
    if (value := given(instance, asked)) is not None:
        return value
    return _first((instance.parent, instance.object, instance.object.data), asked)


def _of_particle(instance: bpy.types.DepsgraphObjectInstance, asked: str) -> Rgba:
    """Fact about the particle that shows an instance; children have none, as in Cycles."""
    particles = instance.particle_system.particles if instance.particle_system is not None else ()
    index = instance.persistent_id[0]
    particle = particles[index] if 0 <= index < len(particles) else None
    if asked in {"Index", "Random"}:
        number = index if particle is not None else 0
        value = float(number) if asked == "Index" else random_of_number(number, 2)
    elif particle is None:
        value = 0.0
    elif asked == "Age":
        value = bpy.context.scene.frame_current_final - particle.birth_time
    elif asked in {"Lifetime", "Size"}:
        value = getattr(particle, asked.lower())
    else:
        x, y, z = getattr(particle, asked.lower().replace(" ", "_"))
        return x, y, z, 1.0
    return value, value, value, value


def _first(owners: Iterable[Any], name: str) -> Rgba:
    found = (find_rgba(owner, name) for owner in owners if owner is not None)
    return next((value for value in found if value is not None), NO_VALUE)


def find_rgba(owner: Any, name: str) -> Rgba | None:
    """Value of a custom property or a path to a property as a colour; None of what has no one to four numbers. Blender
    finds no single numbers of an array."""
    value: Any
    try:
        value = owner[name] if name in owner.keys() else owner.path_resolve(name)
    except (KeyError, TypeError, ValueError, AttributeError):
        return None
    if isinstance(value, int | float):
        is_one_of_array = name not in owner.keys() and OF_ARRAY.search(name)
        return None if is_one_of_array else (float(value), float(value), float(value), 1.0)
    try:
        numbers = list(value) if len(value) <= 4 else []
    except TypeError:
        return None
    if not numbers or not all(type(number) in {int, float} for number in numbers):
        return None
    filled = numbers + [0.0, 0.0, 0.0, 1.0][len(numbers) :]
    return filled[0], filled[1], filled[2], filled[3]


def _finite(value: Rgba) -> Rgba:
    red, green, blue, alpha = [number if isfinite(number) else 0.0 for number in value]
    return red, green, blue, alpha
