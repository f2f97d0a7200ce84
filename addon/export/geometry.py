"""Evaluated meshes in bulk: attribute arrays as they are, triangulated by the native module."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np

from .arrays import touched

FIELDS: dict[str, tuple[str, int, Any]] = {
    "BOOLEAN": ("value", 1, np.bool_),
    "INT8": ("value", 1, np.int32),
    "INT": ("value", 1, np.int32),
    "FLOAT": ("value", 1, np.float32),
    "FLOAT2": ("vector", 2, np.float32),
    "FLOAT_VECTOR": ("vector", 3, np.float32),
    "BYTE_COLOR": ("color", 4, np.float32),
    "FLOAT_COLOR": ("color", 4, np.float32),
    "QUATERNION": ("value", 4, np.float32),
}
"""Where an attribute of a type has its values, and how many, of the types that Cycles reads."""


class GeometryExporter:
    """Exports each evaluated mesh once and remembers its number."""

    def __init__(self, builder: Any, asked: Collection[str]):
        self.builder = builder
        self.asked = asked
        """Names of attributes that materials read."""
        self.numbers: dict[int, int | None] = {}
        self.attributes: dict[int, set[str]] = {}
        """Of a mesh's number: names of what materials can read."""

    def mesh_number(self, mesh: bpy.types.Mesh) -> int | None:
        """Number of an evaluated mesh; None if it has no faces. Evaluated meshes are shared by all instances of one
        evaluated object and by linked duplicates without modifiers."""
        key = mesh.as_pointer()
        if key not in self.numbers:
            self.numbers[key] = self._export(mesh) if len(mesh.polygons) > 0 else None
        return self.numbers[key]

    def _export(self, mesh: bpy.types.Mesh) -> int:
        arrays = mesh_arrays(mesh, self.asked)
        number = self.builder.add_mesh(mesh.name, **arrays)
        self.attributes[number] = set(arrays["color_attributes"])
        return number


def mesh_arrays(mesh: bpy.types.Mesh, asked: Collection[str] = ()) -> dict[str, Any]:
    """The arrays that `SceneBuilder.add_mesh` takes, one copy each; attributes that are `asked` for by name are among
    the colours. Attributes are read by their stored arrays: `vertices.co` and its like are up to 300 times slower."""
    faces, corners, vertices = len(mesh.polygons), len(mesh.loops), len(mesh.vertices)
    arrays: dict[str, Any] = {
        "positions": _attribute(mesh, "position", "vector", (vertices, 3), np.float32),
        "corner_verts": _attribute(mesh, ".corner_vert", "value", corners, np.int32),
        "face_starts": _collection(mesh.polygons, "loop_start", faces, np.int32),
        "uv_maps": {
            layer.name: _attribute(mesh, layer.name, "vector", (corners, 2), np.float32)
            for layer in sorted(mesh.uv_layers, key=lambda layer: not layer.active_render)
        },
    }
    # Centre and half size, so that generated coordinates are Cycles' after a modifier changed the mesh.
    arrays["texture_space"] = [list(mesh.texspace_location), list(mesh.texspace_size)]
    arrays["color_attributes"] = _color_attributes(mesh, arrays["corner_verts"])
    for name in sorted(set(asked) - arrays["color_attributes"].keys()):
        attribute = mesh.attributes.get(name)
        if attribute is not None and attribute.data_type in FIELDS and attribute.domain in {"POINT", "CORNER", "FACE"}:
            arrays["color_attributes"][name] = _as_colors(attribute, arrays["corner_verts"], arrays["face_starts"])
    if _has_attribute(mesh, "material_index", "INT", "FACE"):
        arrays["material_slots"] = _attribute(mesh, "material_index", "value", faces, np.int32)
    if mesh.normals_domain == "POINT":
        arrays["vertex_normals"] = _collection(mesh.vertex_normals, "vector", (vertices, 3), np.float32)
    elif mesh.normals_domain == "CORNER":
        arrays["corner_normals"] = _collection(mesh.corner_normals, "vector", (corners, 3), np.float32)
        # Where sharp faces are flat in Cycles: in older versions, and never against custom normals.
        is_flat = bpy.app.version < (5, 0) and not mesh.has_custom_normals
        if is_flat and _has_attribute(mesh, "sharp_face", "BOOLEAN", "FACE"):
            arrays["sharp_faces"] = _attribute(mesh, "sharp_face", "value", faces, np.bool_)
    return arrays


def _color_attributes(mesh: bpy.types.Mesh, corner_verts: np.ndarray) -> dict[str, np.ndarray]:
    """Scene-linear colours [C, 4], the one that renders first."""
    attributes = mesh.color_attributes
    first = attributes.render_color_index
    colors = {}
    for _, attribute in sorted(enumerate(attributes), key=lambda entry: entry[0] != first):
        values = _collection(attribute.data, "color", (len(attribute.data), 4), np.float32)
        colors[attribute.name] = values[corner_verts] if attribute.domain == "POINT" else values
    return colors


def _as_colors(attribute: bpy.types.Attribute, corner_verts: np.ndarray, face_starts: np.ndarray) -> np.ndarray:
    """What Cycles makes of any attribute, [C, 4]: numbers are grey, what vectors lack is 0, and alpha 1."""
    field, width, dtype = FIELDS[attribute.data_type]
    values = _collection(attribute.data, field, (len(attribute.data), width), dtype)
    colors = np.zeros((len(values), 4), np.float32)
    colors[:, 3] = 1.0
    colors[:, : 3 if width == 1 else width] = values
    if attribute.domain == "CORNER":
        return colors
    faces = np.diff(face_starts, append=len(corner_verts))
    return colors[corner_verts] if attribute.domain == "POINT" else np.repeat(colors, faces, axis=0)


def _has_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str) -> bool:
    attribute = mesh.attributes.get(name)
    return attribute is not None and attribute.data_type == data_type and attribute.domain == domain


def _attribute(mesh: bpy.types.Mesh, name: str, field: str, shape: Any, dtype: Any) -> np.ndarray:
    return _collection(mesh.attributes[name].data, field, shape, dtype)


def _collection(collection: Any, field: str, shape: Any, dtype: Any) -> np.ndarray:
    array = touched(shape, dtype)
    collection.foreach_get(field, array.reshape(-1))
    return array
