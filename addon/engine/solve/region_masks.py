"""Masks of objects and materials in the picture, by rays of the camera, cast a few at a time so that Blender's window
goes on. Rays hit surfaces that the window shows; they pass through those that the camera does not see in renders."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ...core.solve import SolveError
from ...export.camera import PLANAR
from ..staleness.fingerprints import GEOMETRY

SIZE = 160
"""Rays along the longer side of the picture."""
SLICE_SECONDS = 0.01
MOST_HITS = 64
"""Surfaces that are not in renders, one behind another, that a ray passes."""
STEP = 1e-5
"""Distance behind a surface from which a ray goes on, as a share of its way so far."""
OBJECT, MATERIAL, OBJECT_INDEX, MATERIAL_INDEX = KINDS = ("OBJECT", "MATERIAL", "OBJECT_INDEX", "MATERIAL_INDEX")


@dataclass(frozen=True)
class MaskSubject:
    """Object, material or index whose mask is asked for."""

    kind: str
    """One of KINDS."""
    key: str | int
    """Name of the object or material, or a pass index."""

    def __str__(self) -> str:
        kind = self.kind.lower().replace("_", " ")
        return f"{kind} {self.key}" if isinstance(self.key, int) else f"{kind} '{self.key}'"


def masks(scene_uid: int, subjects: list[MaskSubject], aspect: float) -> Iterator[dict[MaskSubject, np.ndarray] | None]:
    """Yields None after every slice of work, and masks [height, width, 1] of 0 and 1, top row first, in the end. Scene
    and camera are looked up anew in every slice: undo replaces them. Raises SolveError where the window shows another
    scene by then: Blender evaluates only the one that is shown."""
    width, height = (SIZE, max(round(SIZE / aspect), 1)) if aspect >= 1.0 else (max(round(SIZE * aspect), 1), SIZE)
    masks_by_subject = {subject: np.zeros((height, width, 1), np.float32) for subject in subjects}
    place, end = 0, width * height
    unseen: _Unseen | None = None
    while place < end:
        deadline = time.perf_counter() + SLICE_SECONDS
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == scene_uid), None)
        if scene is None or scene.camera is None:
            return
        if bpy.context.scene != scene:
            raise SolveError(
                f"Objects are looked for while scene '{scene.name}' is shown: go back to it and solve again"
            )
        if scene.camera.data.type not in PLANAR:
            raise SolveError(
                "Objects cannot be looked for in panoramas: paint the region, or use a picture as its mask"
            )
        unseen = unseen or _Unseen(scene)
        cast = _Caster(scene, unseen)
        while place < end and time.perf_counter() < deadline:
            y, x = divmod(place, width)
            hit = cast((x + 0.5) / width, (y + 0.5) / height)
            if hit is not None:
                for subject in subjects:
                    masks_by_subject[subject][y, x, 0] = hit[subject.kind] == subject.key
            place += 1
        yield None
    yield masks_by_subject


def not_shown(scene: bpy.types.Scene, subject: MaskSubject) -> list[str]:
    """Names of objects that are in renders and have a subject, but are hidden in the window, where no ray meets
    them."""
    unseen = _Unseen(scene)
    return [obj.name for obj in scene.objects if _has(obj, subject) and unseen.is_only_in_renders(obj)]


def _has(obj: bpy.types.Object, subject: MaskSubject) -> bool:
    if subject.kind == OBJECT:
        return obj.name == subject.key
    if subject.kind == OBJECT_INDEX:
        return obj.type in GEOMETRY and obj.pass_index == subject.key
    materials = [slot.material for slot in obj.material_slots if slot.material is not None]
    if subject.kind == MATERIAL:
        return any(material.name == subject.key for material in materials)
    return any(material.pass_index == subject.key for material in materials)


class _Unseen:
    """Objects that the camera does not see in renders although the window may show them. Holds plain data: data-blocks
    may be gone in the next slice."""

    def __init__(self, scene: bpy.types.Scene):
        layer = bpy.context.view_layer
        roots = [obj.instance_collection for obj in bpy.data.objects if obj.instance_collection is not None]
        rendered = {obj for collection in _rendered([scene.collection, *roots]) for obj in collection.objects}
        self.objects = {
            obj.session_uid
            for obj in bpy.data.objects
            if obj not in rendered
            or obj.hide_render
            or not obj.visible_camera
            or obj.indirect_only_get(view_layer=layer)
        }
        self.instances: set[tuple] = set()
        """Places of instances whose instancer is not seen."""
        if any(obj.session_uid in self.objects and _may_instance(obj) for obj in scene.objects):
            for instance in bpy.context.evaluated_depsgraph_get().object_instances:
                parent = instance.parent
                if instance.is_instance and parent and parent.original.session_uid in self.objects:
                    self.instances.add(_key(instance.object, instance.matrix_world))

    def lets_through(self, obj: bpy.types.Object, world_from_object: Matrix) -> bool:
        """True if an object that a ray has hit is not there in renders."""
        return obj.original.session_uid in self.objects or _key(obj, world_from_object) in self.instances

    def is_only_in_renders(self, obj: bpy.types.Object) -> bool:
        """True if the camera sees an object in renders and the window hides it."""
        return obj.session_uid not in self.objects and not obj.visible_get()


def _rendered(collections: list[bpy.types.Collection]) -> set[bpy.types.Collection]:
    """Collections and their children, without those that are left out of renders."""
    rendered: set[bpy.types.Collection] = set()
    waiting = list(collections)
    while waiting:
        collection = waiting.pop()
        if collection not in rendered and not collection.hide_render:
            rendered.add(collection)
            waiting += collection.children
    return rendered


def _may_instance(obj: bpy.types.Object) -> bool:
    nodes = any(modifier.type == "NODES" for modifier in obj.modifiers)
    return nodes or obj.instance_type != "NONE" or bool(obj.particle_systems)


def _key(obj: bpy.types.Object, world_from_object: Matrix) -> tuple:
    return obj.original.session_uid, *(number for row in world_from_object for number in row)


class _Caster:
    """Casts rays through places in the picture."""

    def __init__(self, scene: bpy.types.Scene, unseen: _Unseen):
        self.scene, self.unseen = scene, unseen
        self.depsgraph = bpy.context.evaluated_depsgraph_get()
        camera = scene.camera.evaluated_get(self.depsgraph)
        self.world_from_camera = camera.matrix_world.normalized()
        corners = camera.data.view_frame(scene=scene)
        self.low = Vector(min(corner[axis] for corner in corners) for axis in range(3))
        self.high = Vector(max(corner[axis] for corner in corners) for axis in range(3))
        self.is_orthographic = camera.data.type == "ORTHO"
        self.near = camera.data.clip_start

    def __call__(self, x: float, y: float) -> dict[str, Any] | None:
        """Objects, materials and indices, by KINDS, that are seen at fractions of the picture from its top left corner;
        None if nothing is hit."""
        place = Vector(
            (self.low.x + x * (self.high.x - self.low.x), self.high.y - y * (self.high.y - self.low.y), self.low.z)
        )
        toward = Vector((0.0, 0.0, -1.0)) if self.is_orthographic else place.normalized()
        start = Vector((place.x, place.y, 0.0)) if self.is_orthographic else Vector()
        origin = self.world_from_camera @ (start + self.near * toward)
        direction = self.world_from_camera.to_3x3() @ toward
        hit = self._first_seen(origin, direction)
        if hit is None:
            return None
        obj, face = hit
        material = self._material(obj, face)
        return {
            OBJECT: obj.original.name,
            OBJECT_INDEX: obj.pass_index,
            MATERIAL: material.original.name if material else None,
            MATERIAL_INDEX: material.pass_index if material else 0,
        }

    def _first_seen(self, origin: Vector, direction: Vector) -> tuple[bpy.types.Object, int] | None:
        """The first object on a ray that renders show, and the number of its face."""
        start = origin
        for _ in range(MOST_HITS):
            is_hit, place, _normal, face, obj, matrix = self.scene.ray_cast(self.depsgraph, start, direction)
            if not is_hit:
                return None
            if not self.unseen.lets_through(obj, matrix):
                return obj, face
            start = place + STEP * max((place - origin).length, self.near) * direction
        return None

    def _material(self, obj: bpy.types.Object, face: int) -> bpy.types.Material | None:
        evaluated = obj.evaluated_get(self.depsgraph)
        if not evaluated.material_slots:
            return None
        polygons = getattr(evaluated.data, "polygons", ())
        slot = polygons[face].material_index if 0 <= face < len(polygons) else 0
        return evaluated.material_slots[min(slot, len(evaluated.material_slots) - 1)].material
