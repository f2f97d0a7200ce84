"""Attributes that materials ask whole objects, instancers and view layers for: custom properties, and any property of
theirs with up to four numbers. Looked up as in Blender's `BKE_object_dupli_find_rgba_attribute`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from math import isfinite
from typing import Any, TypeAlias

import bpy

Rgba: TypeAlias = tuple[float, float, float, float]

OF_INSTANCER = {"generated": "\tgenerated of instancer", "uv": "\tUV of instancer"}
"""Names of an instance's coordinates on its instancer."""
OF_ARRAY = re.compile(r"\[\d+\]$")
NO_VALUE: Rgba = (0.0, 0.0, 0.0, 0.0)


def object_name(kind: str, name: str) -> str:
    """Name under which a material asks an object, or where `kind` is INSTANCER its instancer, for an attribute."""
    return f"\t{kind}\t{name}"


def values_of_instance(instance: bpy.types.DepsgraphObjectInstance, names: Iterable[str]) -> list[tuple[str, Rgba]]:
    """Values of an instance for the names that materials ask it for."""
    return [(name, _finite(_value(instance, name))) for name in sorted(names)]


def asks_instancer(names: Iterable[str]) -> bool:
    """True if materials ask for attributes that an instancer may give its instances."""
    return any(name.startswith(object_name("INSTANCER", "")) for name in names)


def value_of_layer(scene: bpy.types.Scene, layer: bpy.types.ViewLayer, name: str) -> Rgba:
    """Value of an attribute of a view layer, or else of its scene or world."""
    return _finite(_first((layer, scene, scene.world), name))


def _value(instance: bpy.types.DepsgraphObjectInstance, name: str) -> Rgba:
    if name == OF_INSTANCER["generated"]:
        # Cycles' own scale of what Blender gives.
        return (*(0.5 * value - 0.5 for value in instance.orco), 1.0) if instance.is_instance else NO_VALUE
    if name == OF_INSTANCER["uv"]:
        return (*instance.uv, 0.0, 1.0) if instance.is_instance else NO_VALUE
    _, kind, asked = name.split("\t", 2)
    return _first(_owners(instance, kind == "INSTANCER"), asked)


def _owners(instance: bpy.types.DepsgraphObjectInstance, of_instancer: bool) -> Iterator[bpy.types.ID | None]:
    if of_instancer and instance.is_instance:
        if instance.particle_system is not None:
            yield instance.particle_system.settings
        yield instance.parent
    yield instance.object
    yield instance.object.data


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
    red, green, blue, alpha = [*numbers, *(0.0, 0.0, 0.0, 1.0)[len(numbers) :]]
    return red, green, blue, alpha


def _finite(value: Rgba) -> Rgba:
    red, green, blue, alpha = [number if isfinite(number) else 0.0 for number in value]
    return red, green, blue, alpha
