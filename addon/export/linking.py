"""Light linking: which objects a light shines on, and which block it."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import bpy

from ..core.receivers import RECEIVER_LIMIT, numbers_of
from .materials.graph import has_volume

SPACE = "\tspace"
"""Name of the world's medium among the objects; no collection can hold it."""
NEVER_LIT = frozenset({"LIGHT", "CAMERA", "LIGHT_PROBE", "SPEAKER"})


def receiver_names(scene: bpy.types.Scene) -> list[str]:
    """Full names of the objects that light linking counts, in order: all that have a surface or may instance one. Lamps
    and cameras have no number, so that those of surfaces, which a bake depends on, stay when a lamp comes or goes. A
    medium that fills all space is the last."""
    objects = [obj.name_full for obj in scene.objects if obj.type not in NEVER_LIT]
    worlds = [scene.world, *(layer.world_override for layer in scene.view_layers)]
    return [*objects, SPACE] if any(map(has_volume, filter(None, worlds))) else objects


class LightLinking:
    """Gives every object a receiver number: its place in `objects`, see `receiver_names`. Objects beyond the limit
    share the last one."""

    def __init__(self, objects: list[str], warn: Callable[[str], None]):
        """`objects` are the names of the objects that can receive light, by number."""
        self.warn = warn
        self.objects = objects

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Numbers of objects by full name."""
        return {name: number for number, name in enumerate(self.objects)}

    def receiver_number(self, obj: bpy.types.Object, owner: bpy.types.Object) -> int:
        """Number of the object that an instance belongs to: its instancer where it has one."""
        number = self.numbers.get(owner.name_full, self.numbers.get(obj.name_full, RECEIVER_LIMIT - 1))
        return min(number, RECEIVER_LIMIT - 1)

    @property
    def space_number(self) -> int:
        """Number of the world's medium."""
        return min(self.numbers.get(SPACE, 0), RECEIVER_LIMIT - 1)

    def receivers(self, light: bpy.types.Object) -> list[int] | None:
        """Sorted receiver numbers of a light; None if it shines on everything."""
        return self._numbers_in(light, light.light_linking.receiver_collection)

    def blockers(self, light: bpy.types.Object) -> list[int] | None:
        """Sorted receiver numbers of the only objects that block a light; None if everything does."""
        return self._numbers_in(light, light.light_linking.blocker_collection)

    def _numbers_in(self, light: bpy.types.Object, collection: bpy.types.Collection | None) -> list[int] | None:
        if collection is None:
            return None
        states = link_states(collection.original)
        if len(self.objects) > RECEIVER_LIMIT:
            self.warn(
                f"light '{light.name}': light linking is exact for the first {RECEIVER_LIMIT} objects only; "
                "the others count as one"
            )
        # Without any included object, everything that is not excluded counts.
        exclude_only = "INCLUDE" not in states.values()
        counted = (
            number
            for number, name in enumerate(self.objects)
            if states.get(name, "INCLUDE" if exclude_only else "EXCLUDE") == "INCLUDE"
        )
        return numbers_of(counted)


def link_states(collection: bpy.types.Collection) -> dict[str, str]:
    """INCLUDE or EXCLUDE of each object named by a receiver collection; nested collections first, so that the
    state of an object itself wins."""
    states: dict[str, str] = {}
    for entry, child in zip(collection.collection_children, collection.children, strict=True):
        state = entry.light_linking.link_state
        states.update({obj.name_full: state for obj in child.all_objects})
    for entry, obj in zip(collection.collection_objects, collection.objects, strict=True):
        states[obj.name_full] = entry.light_linking.link_state
    return states
