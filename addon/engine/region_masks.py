"""Where objects and materials are seen in the picture: rays of the camera, cast a few at a time so that Blender's
window goes on."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Vector

from ..core.solve import SolveError

SIZE = 160
"""Rays along the longer side of the picture."""
SLICE_SECONDS = 0.01
OBJECT, MATERIAL, OBJECT_INDEX, MATERIAL_INDEX = KINDS = ("OBJECT", "MATERIAL", "OBJECT_INDEX", "MATERIAL_INDEX")


@dataclass(frozen=True)
class Seen:
    """What is asked for."""

    kind: str
    """One of KINDS."""
    key: str | int
    """Name of the object or material, or a pass index."""

    def __str__(self) -> str:
        what = self.kind.lower().replace("_", " ")
        return f"{what} {self.key}" if isinstance(self.key, int) else f"{what} '{self.key}'"


def masks(scene_uid: int, wanted: list[Seen], aspect: float) -> Iterator[dict[Seen, np.ndarray] | None]:
    """Yields None after every slice of work, and masks [height, width, 1] of 0 and 1, top row first, in the end. Scene
    and camera are looked up anew in every slice: undo replaces them. Raises SolveError where the window shows another
    scene by then: Blender evaluates only the one that is shown."""
    width, height = (SIZE, max(round(SIZE / aspect), 1)) if aspect >= 1.0 else (max(round(SIZE * aspect), 1), SIZE)
    found = {seen: np.zeros((height, width, 1), np.float32) for seen in wanted}
    place, end = 0, width * height
    while place < end:
        deadline = time.perf_counter() + SLICE_SECONDS
        scene = next((scene for scene in bpy.data.scenes if scene.session_uid == scene_uid), None)
        if scene is None or scene.camera is None:
            return
        if bpy.context.scene != scene:
            raise SolveError(
                f"Objects are looked for while scene '{scene.name}' is shown: go back to it and solve again"
            )
        cast = _Caster(scene)
        while place < end and time.perf_counter() < deadline:
            y, x = divmod(place, width)
            hit = cast((x + 0.5) / width, (y + 0.5) / height)
            if hit is not None:
                for seen in wanted:
                    found[seen][y, x, 0] = hit[seen.kind] == seen.key
            place += 1
        yield None
    yield found


class _Caster:
    """Casts rays through places in the picture."""

    def __init__(self, scene: bpy.types.Scene):
        self.scene = scene
        self.depsgraph = bpy.context.evaluated_depsgraph_get()
        camera = scene.camera.evaluated_get(self.depsgraph)
        self.world_from_camera = camera.matrix_world.normalized()
        corners = camera.data.view_frame(scene=scene)
        self.low = Vector(min(corner[axis] for corner in corners) for axis in range(3))
        self.high = Vector(max(corner[axis] for corner in corners) for axis in range(3))
        self.is_orthographic = camera.data.type == "ORTHO"
        self.near = camera.data.clip_start

    def __call__(self, x: float, y: float) -> dict[str, Any] | None:
        """What is seen at fractions of the picture from its top left corner, by KINDS; None for nothing."""
        place = Vector(
            (self.low.x + x * (self.high.x - self.low.x), self.high.y - y * (self.high.y - self.low.y), self.low.z)
        )
        toward = Vector((0.0, 0.0, -1.0)) if self.is_orthographic else place.normalized()
        start = Vector((place.x, place.y, 0.0)) if self.is_orthographic else Vector()
        origin = self.world_from_camera @ (start + self.near * toward)
        direction = self.world_from_camera.to_3x3() @ toward
        is_hit, _place, _normal, face, obj, _matrix = self.scene.ray_cast(self.depsgraph, origin, direction)
        if not is_hit:
            return None
        material = self._material(obj, face)
        return {
            OBJECT: obj.original.name,
            OBJECT_INDEX: obj.pass_index,
            MATERIAL: material.original.name if material else None,
            MATERIAL_INDEX: material.pass_index if material else 0,
        }

    def _material(self, obj: bpy.types.Object, face: int) -> bpy.types.Material | None:
        evaluated = obj.evaluated_get(self.depsgraph)
        if not evaluated.material_slots:
            return None
        polygons = getattr(evaluated.data, "polygons", ())
        slot = polygons[face].material_index if 0 <= face < len(polygons) else 0
        return evaluated.material_slots[min(slot, len(evaluated.material_slots) - 1)].material
