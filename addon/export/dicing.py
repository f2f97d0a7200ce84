"""Adaptive subdivision: meshes that stand for surfaces, and how finely those are diced."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from .arrays import stored
from .camera import WatchedCamera, camera_json

OF_CAGE = (4, 5, 0)
"""Version from which on the surface is that of the mesh before the modifier. Before, the modifier's own levels come
first, and the surface is that of the mesh which they make."""
CREASE_SHARPNESS = 10.0
"""Sharpness of a full crease."""
BORDERS = {"PRESERVE_CORNERS": "corners", "ALL": "smooth"}
"""Borders of surfaces by `boundary_smooth`."""
UV_BORDERS = {
    "NONE": None,
    "PRESERVE_CORNERS": "corners",
    "PRESERVE_CORNERS_AND_JUNCTIONS": "corners",
    "PRESERVE_CORNERS_JUNCTIONS_AND_CONCAVE": "corners",
    "PRESERVE_BOUNDARIES": "straight",
    "SMOOTH_ALL": "smooth",
}
"""Borders of UV maps by `uv_smooth`; None where maps are bilinear."""


def adaptive_modifier(obj: bpy.types.Object, scene: bpy.types.Scene) -> bpy.types.SubsurfModifier | None:
    """The modifier that subdivides an object adaptively in renders; None if there is none."""
    modifier = obj.modifiers[-1] if obj.type == "MESH" and obj.modifiers else None
    if modifier is None or modifier.type != "SUBSURF" or not modifier.show_render:
        return None
    if hasattr(modifier, "use_adaptive_subdivision"):  # From Blender 5.0 on.
        return modifier if modifier.use_adaptive_subdivision else None
    cycles, of_object = getattr(scene, "cycles", None), getattr(obj, "cycles", None)
    if cycles is None or of_object is None or cycles.feature_set != "EXPERIMENTAL":
        return None
    return modifier if of_object.use_adaptive_subdivision else None


def dicing_camera(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The camera that a scene's meshes are diced for; None if it is that of the picture."""
    cycles = getattr(scene, "cycles", None)
    camera = cycles.dicing_camera if cycles is not None else None
    return camera if camera is not None and camera.type == "CAMERA" else None


def dicing_settings(scene: bpy.types.Scene) -> list[Any] | None:
    """Settings of a scene that adaptive subdivision follows; None where no object has it."""
    if not any(adaptive_modifier(obj, scene) for obj in scene.objects):
        return None
    cycles: Any = scene.cycles
    return [cycles.dicing_rate, cycles.max_subdivisions, cycles.offscreen_dicing_scale]


@contextmanager
def cage_of(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Iterator[bpy.types.Mesh]:
    """The mesh whose surface an object with adaptive subdivision shows. It is there within the context. Only the
    evaluated copy of the modifier is switched off meanwhile."""
    obj = obj.original.evaluated_get(depsgraph)  # Instances are copies that Blender makes for a moment.
    if bpy.app.version < OF_CAGE:
        yield obj.to_mesh() if obj.data.is_editmode else obj.data
        return
    shown = [modifier.show_render for modifier in obj.modifiers]
    # Other ways to set it would have Blender evaluate the object anew.
    obj.modifiers.foreach_set("show_render", [*shown[:-1], False])
    try:
        yield obj.to_mesh(preserve_all_data_layers=True, depsgraph=depsgraph)
    finally:
        obj.to_mesh_clear()
        obj.modifiers.foreach_set("show_render", shown)


def set_normals(arrays: dict[str, Any], mesh: bpy.types.Mesh, is_smooth: bool, is_displaced: bool) -> None:
    """Puts those normals in the arrays of a cage that its diced form has."""
    normals = stored(mesh.vertex_normals, np.float32, 3).copy()
    flat = arrays.pop("sharp_faces", None)
    attribute = mesh.attributes.get("sharp_face")
    if attribute is not None and (attribute.data_type, attribute.domain) == ("BOOLEAN", "FACE"):
        flat = stored(attribute.data, np.bool_).copy()
    keeps_corners = not is_smooth and bpy.app.version >= (5, 0, 0) and "corner_normals" in arrays
    if not keeps_corners:
        arrays.pop("corner_normals", None)
        arrays["vertex_normals"] = normals
    if flat is not None and not keeps_corners:
        if bpy.app.version >= OF_CAGE:
            arrays["sharp_faces"] = flat
        elif not is_smooth:  # All triangles of a face have the normal of its first three corners.
            corners = np.diff(arrays["face_starts"], append=len(arrays["corner_verts"]))
            first = arrays["corner_verts"][arrays["face_starts"][:, None] + np.arange(3)]
            a, b, c = np.moveaxis(arrays["positions"][first], 1, 0)
            of_faces = np.repeat(np.cross(b - a, c - a), corners, axis=0)
            of_faces /= np.maximum(np.linalg.norm(of_faces, axis=1, keepdims=True), np.float32(1e-30))
            is_flat = np.repeat(flat, corners)[:, None]
            arrays["corner_normals"] = np.where(is_flat, of_faces, normals[arrays["corner_verts"]])
    if is_displaced:
        arrays["displacement_normals"] = normals
        arrays["turns_corner_normals"] = keeps_corners and bpy.app.version >= (5, 2, 0)


class DicingExporter:
    """How finely the meshes of a scene are diced."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, camera: WatchedCamera, size: tuple[int, int]):
        """`camera` and `size` are those of the picture."""
        self.depsgraph, self.size = depsgraph, size
        chosen = dicing_camera(depsgraph.scene)
        self.camera = chosen.evaluated_get(depsgraph) if chosen is not None else camera

    def modifier(self, obj: bpy.types.Object) -> bpy.types.SubsurfModifier | None:
        """The modifier that subdivides an evaluated object adaptively. Meshes that nodes add have none."""
        shown = obj.original.evaluated_get(self.depsgraph)
        is_own = shown.data is not None and obj.data.as_pointer() == shown.data.as_pointer()
        return adaptive_modifier(obj, self.depsgraph.scene) if is_own else None

    def arguments(
        self, obj: bpy.types.Object, modifier: bpy.types.SubsurfModifier, mesh: bpy.types.Mesh
    ) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
        """The argument of `SceneBuilder.add_mesh` for the cage of an object."""
        cycles = self.depsgraph.scene.cycles
        rate = cycles.dicing_rate
        if getattr(modifier, "adaptive_space", "PIXEL") == "OBJECT":
            edge, screen = modifier.adaptive_object_edge_length * rate, None
        else:
            pixels = modifier.adaptive_pixel_size if hasattr(modifier, "adaptive_space") else obj.cycles.dicing_rate
            edge = max(0.1, pixels * rate)
            place = obj.original.evaluated_get(self.depsgraph).matrix_world  # As in Cycles, also of instances.
            screen = {
                "camera": json.loads(camera_json(self.camera, self.depsgraph.scene_eval, self.size)),
                "world_from_object": [list(row) for row in place],
                "offscreen_scale": cycles.offscreen_dicing_scale,
            }
        is_smooth = modifier.subdivision_type == "CATMULL_CLARK"
        settings = {
            "edge": edge,
            "levels": cycles.max_subdivisions,
            "smooth": _smooth(modifier) if is_smooth else None,
            "screen": screen,
        }
        has_creases = is_smooth and modifier.use_creases
        return json.dumps(settings), *_creases(mesh, has_creases)


def _smooth(modifier: bpy.types.SubsurfModifier) -> dict[str, Any]:
    border = BORDERS[modifier.boundary_smooth] if bpy.app.version >= OF_CAGE else "smooth"
    return {"border": border, "uv_border": UV_BORDERS[modifier.uv_smooth]}


def _creases(mesh: bpy.types.Mesh, has_creases: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices of sharp edges, their sharpness, and that of all vertices; nothing where all are smooth."""
    edges, vertices = (mesh.attributes.get(name) if has_creases else None for name in ("crease_edge", "crease_vert"))
    weights = stored(edges.data, np.float32) if edges is not None else np.zeros(0, np.float32)
    sharp = weights.nonzero()[0]
    ends = stored(mesh.edges, np.int32, 2)[sharp] if len(sharp) else np.zeros((0, 2), np.int32)
    of_vertices = stored(vertices.data, np.float32) if vertices is not None else np.zeros(0, np.float32)
    return np.ascontiguousarray(ends), weights[sharp] * CREASE_SHARPNESS, of_vertices * CREASE_SHARPNESS
