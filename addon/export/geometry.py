"""Evaluated meshes in bulk: attribute arrays as they are, triangulated by the native module."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import nullcontext
from typing import Any

import bpy
import numpy as np

from .arrays import LAYOUTS, stored
from .attributes import UNREAD, as_colors, as_factors, attribute_values
from .curves import Move
from .dicing import DicingExporter, cage_of, set_normals
from .materials import ANY_UV_MAP, FACTOR
from .shape_attributes import of_shape


class GeometryExporter:
    """Exports each evaluated mesh once and remembers its number."""

    def __init__(self, builder: Any, attribute_names: Collection[str], dicing: DicingExporter):
        self.builder, self.dicing = builder, dicing
        self.attribute_names = attribute_names
        """Names of attributes that materials read."""
        self.numbers: dict[tuple[int, bool], int | None] = {}
        """Numbers of evaluated meshes by their addresses, and by being displaced."""
        self.attributes: dict[int, set[str]] = {}
        """Names of attributes that materials can read, by mesh number."""

    def mesh_number(self, obj: bpy.types.Object, is_displaced: bool, move: Move) -> int | None:
        """Number of the mesh of an evaluated object; None if it has no faces, or damaged ones. Evaluated meshes are
        shared by all instances of one evaluated object and by linked duplicates without modifiers. `is_displaced`: a
        material of the object displaces it. `move` finds its motion."""
        key = obj.data.as_pointer(), is_displaced
        if key not in self.numbers:
            modifier = self.dicing.modifier(obj)
            with cage_of(obj, self.dicing.depsgraph) if modifier else nullcontext(shown_mesh(obj)) as mesh:
                arrays = self._arrays(obj, mesh, is_displaced, move, modifier) if len(mesh.polygons) else None
                self.numbers[key] = self._add(obj, mesh, arrays) if arrays else None
        return self.numbers[key]

    def _arrays(
        self,
        obj: bpy.types.Object,
        mesh: bpy.types.Mesh,
        is_displaced: bool,
        move: Move,
        modifier: bpy.types.SubsurfModifier | None,
    ) -> dict[str, Any]:
        arrays = mesh_arrays(mesh, self.attribute_names)
        arrays |= move(arrays["positions"], mesh.attributes)
        if modifier is not None:
            arrays["dicing"] = self.dicing.arguments(obj, modifier, mesh)
            set_normals(arrays, mesh, modifier.subdivision_type == "CATMULL_CLARK", is_displaced)
        elif is_displaced:
            add_displacement(arrays, mesh)
        return arrays

    def _add(self, obj: bpy.types.Object, mesh: bpy.types.Mesh, arrays: dict[str, Any]) -> int | None:
        """Number of a mesh that an object shows; None, and a warning, of one that is damaged beyond repair."""
        try:
            number = self.builder.add_mesh(mesh.name, **arrays, shown_by=obj.name)
        except ValueError as error:
            self.builder.warn(f"object '{obj.name}': {error}; left out")
            return None
        names = (*arrays["color_attributes"], *arrays["uv_maps"])
        self.attributes[number] = {name.removesuffix(FACTOR) for name in names}
        if arrays["uv_maps"]:
            self.attributes[number].add(ANY_UV_MAP)
        return number


def shown_mesh(obj: bpy.types.Object) -> bpy.types.Mesh:
    """The mesh of an evaluated object. While it is edited, its data has no arrays: then Blender
    makes another one, as for Cycles."""
    return obj.to_mesh() if obj.data.is_editmode else obj.data


def is_open(mesh: bpy.types.Mesh) -> bool:
    """True if a mesh has an edge of one face alone, so that it encloses nothing."""
    faces = np.bincount(_attribute(mesh, ".corner_edge"), minlength=1)
    return bool((faces == 1).any())


def mesh_arrays(mesh: bpy.types.Mesh, attribute_names: Collection[str] = ()) -> dict[str, Any]:
    """The arrays that `SceneBuilder.add_mesh` takes, one copy each; attributes of `attribute_names` are among the
    colours. Attributes are read by their stored arrays: `vertices.co` and its like are up to 300 times slower."""
    arrays: dict[str, Any] = {
        "positions": _attribute(mesh, "position"),
        "corner_verts": _attribute(mesh, ".corner_vert"),
        "face_starts": stored(mesh.polygons, np.int32).copy(),
        "uv_maps": {
            layer.name: _attribute(mesh, layer.name)
            for layer in sorted(mesh.uv_layers, key=lambda layer: not layer.active_render)
        },
    }
    # Centre and half size, so that generated coordinates are Cycles' after a modifier changed the mesh.
    arrays["texture_space"] = [list(mesh.texspace_location), list(mesh.texspace_size)]
    arrays["color_attributes"] = _color_attributes(mesh, arrays["corner_verts"])
    arrays["color_attributes"] |= of_shape(mesh, arrays, attribute_names)
    for name in sorted(set(attribute_names) - arrays["color_attributes"].keys() - arrays["uv_maps"].keys()):
        attribute = mesh.attributes.get(name.removesuffix(FACTOR))
        if attribute is not None and _is_readable(attribute):
            colors = _as_colors(mesh, attribute, arrays["corner_verts"], arrays["face_starts"])
            arrays["color_attributes"][name] = as_factors(attribute, colors) if name.endswith(FACTOR) else colors
    if _has_attribute(mesh, "material_index", "INT", "FACE"):
        arrays["material_slots"] = _attribute(mesh, "material_index")
    if mesh.normals_domain == "POINT":
        arrays["vertex_normals"] = stored(mesh.vertex_normals, np.float32, 3).copy()
    elif mesh.normals_domain == "CORNER":
        arrays["corner_normals"] = stored(mesh.corner_normals, np.float32, 3).copy()
        # Where sharp faces are flat in Cycles: in older versions, and never against custom normals.
        is_flat = bpy.app.version < (5, 0) and not mesh.has_custom_normals
        if is_flat and _has_attribute(mesh, "sharp_face", "BOOLEAN", "FACE"):
            arrays["sharp_faces"] = _attribute(mesh, "sharp_face")
    return arrays


def add_displacement(arrays: dict[str, Any], mesh: bpy.types.Mesh) -> None:
    """Adds to the arrays of a mesh what its displacement needs. Where corners of a vertex have normals of their own,
    Cycles turns those as far as the vertex's from Blender 5.2 on; before, it splits the vertex, and the mesh comes
    apart."""
    arrays["displacement_normals"] = stored(mesh.vertex_normals, np.float32, 3).copy()
    if mesh.normals_domain != "CORNER":
        return
    if _has_attribute(mesh, "sharp_face", "BOOLEAN", "FACE"):
        arrays["sharp_faces"] = _attribute(mesh, "sharp_face")
    if bpy.app.version >= (5, 2, 0):
        arrays["turns_corner_normals"] = True
        return
    normals = arrays.pop("corner_normals")
    keys = np.column_stack([arrays["corner_verts"].astype(np.float32), normals]).view(np.int32)
    _, first, split = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    if "motion" in arrays:
        arrays["motion"] = arrays["motion"][:, arrays["corner_verts"][first]]
    arrays["positions"] = arrays["positions"][arrays["corner_verts"][first]]
    arrays["corner_verts"] = split.reshape(-1).astype(np.int32)
    arrays["vertex_normals"] = arrays["displacement_normals"] = normals[first]


def _color_attributes(mesh: bpy.types.Mesh, corner_verts: np.ndarray) -> dict[str, np.ndarray]:
    """Scene-linear colours [C, 4], the one that renders first."""
    attributes = mesh.color_attributes
    first = attributes.render_color_index
    colors = {}
    for _, attribute in sorted(enumerate(attributes), key=lambda entry: entry[0] != first):
        values = attribute_values(attribute)
        colors[attribute.name] = values[corner_verts] if attribute.domain == "POINT" else values
    return colors


def _as_colors(
    mesh: bpy.types.Mesh, attribute: bpy.types.Attribute, corner_verts: np.ndarray, face_starts: np.ndarray
) -> np.ndarray:
    """Colours that Cycles makes of any attribute, [C, 4]."""
    colors = as_colors(attribute)
    if attribute.domain == "CORNER":
        return colors
    if attribute.domain == "EDGE":
        means = _at_vertices(colors, _attribute(mesh, ".edge_verts"), len(mesh.vertices))
        if attribute.data_type == "BOOLEAN":
            means = np.ceil(means)
        elif attribute.data_type in {"INT", "INT8"}:
            means = np.copysign(np.floor(np.abs(means) + 0.5), means)
        return means[corner_verts]
    faces = np.diff(face_starts, append=len(corner_verts))
    return colors[corner_verts] if attribute.domain == "POINT" else np.repeat(colors, faces, axis=0)


def _at_vertices(colors: np.ndarray, edges: np.ndarray, vertex_count: int) -> np.ndarray:
    """Means of the colours of all edges at each vertex, 0 where there are none."""
    ends = edges.reshape(-1)
    sums = [np.bincount(ends, np.repeat(channel, 2), vertex_count) for channel in colors.T]
    edge_counts = np.bincount(ends, minlength=vertex_count)
    return (np.stack(sums, axis=1) / np.maximum(edge_counts, 1)[:, None]).astype(np.float32)


def _is_readable(attribute: bpy.types.Attribute) -> bool:
    return attribute.data_type in LAYOUTS.keys() - UNREAD and attribute.domain in {"POINT", "CORNER", "FACE", "EDGE"}


def _has_attribute(mesh: bpy.types.Mesh, name: str, data_type: str, domain: str) -> bool:
    attribute = mesh.attributes.get(name)
    return attribute is not None and attribute.data_type == data_type and attribute.domain == domain


def _attribute(mesh: bpy.types.Mesh, name: str) -> np.ndarray:
    return attribute_values(mesh.attributes[name])
