"""Meshes that Blender finishes only when somebody asks for them, as plain data that another Blender finishes.

In a render it leaves a subdivision that is the last modifier to the engine (`delay` in its MOD_subsurf.cc), and normals
always. Python asks with its lock held, and Blender's window waits for that lock."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np

from .arrays import LAYOUTS, stored
from .plain import settings_of

SUBDIVIDED_FACES = 25_000
"""Number of faces from which a subdivision is left to another Blender. Fewer hold the lock for some 25 ms on two cores:
the window can spare that."""
IRREGULAR_FACES = 90
"""Faces that take as long as a limit surface adds for an irregular point and one step of quality."""
SHADED_FACES = 250_000
"""Number of faces from which the normals of a mesh that modifiers or shape keys change are left to another Blender.
Other meshes share those of the viewport."""
CREASES = ("crease_edge", "crease_vert")
TOPOLOGY = (".edge_verts", ".corner_vert", ".corner_edge")
"""Blender's own attributes that are part of a shape; other names with a dot hold selections."""


@dataclasses.dataclass(frozen=True)
class LateMesh:
    """An unfinished mesh."""

    plain: dict[str, Any]
    """Argument of `finished`: plain data, and arrays that lie in Blender's memory."""
    geometry: Any
    """Owner of that memory."""


FinishMesh = Callable[[LateMesh, Collection[str]], Callable[[], dict[str, Any]]]
"""Begins to have a mesh finished and read elsewhere, with the named attributes. Returns a function that waits for the
arrays (`geometry.mesh_arrays`). Both raise OSError."""


def late_mesh(obj: bpy.types.Object, render: bpy.types.RenderSettings) -> LateMesh | None:
    """The mesh of an evaluated object where finishing it would hold up the window; None of others."""
    modifier = _last_modifier(obj, render)
    is_changed = modifier is not None or obj.original.data.shape_keys is not None
    if not is_changed or not hasattr(obj, "evaluated_geometry"):
        return None
    levels = _levels(modifier, render) if modifier is not None and modifier.type == "SUBSURF" else 0
    geometry = obj.evaluated_geometry()
    mesh = geometry.mesh_base
    if mesh is None or not _is_heavy(mesh, modifier, levels):
        return None
    subdivision = settings_of(modifier) | {"levels": levels} if levels else None
    return LateMesh(_plain_mesh(mesh) | {"subdivision": subdivision}, geometry)


@contextmanager
def finished(late: dict[str, Any]) -> Iterator[bpy.types.Mesh]:
    """The mesh, in another Blender, where nothing is left of it afterwards."""
    mesh = bpy.data.meshes.new(late["name"])
    obj = bpy.data.objects.new(mesh.name, mesh)
    try:
        _build(mesh, late)
        bpy.context.scene.collection.objects.link(obj)
        if late["subdivision"]:
            modifier = obj.modifiers.new("Subdivision", "SUBSURF")
            for name, value in late["subdivision"].items():
                setattr(modifier, name, value)
        depsgraph = bpy.context.evaluated_depsgraph_get()
        yield obj.evaluated_get(depsgraph).data
    finally:
        bpy.data.objects.remove(obj)
        bpy.data.meshes.remove(mesh)


def _last_modifier(obj: bpy.types.Object, render: bpy.types.RenderSettings) -> bpy.types.Modifier | None:
    for modifier in reversed(obj.modifiers):
        if modifier.show_render and not (modifier.type == "SUBSURF" and _levels(modifier, render) == 0):
            return modifier
    return None


def _levels(modifier: bpy.types.SubsurfModifier, render: bpy.types.RenderSettings) -> int:
    most = render.simplify_subdivision_render if render.use_simplify else modifier.render_levels
    return min(modifier.render_levels, most)


def _is_heavy(mesh: bpy.types.Mesh, modifier: bpy.types.Modifier | None, levels: int) -> bool:
    if modifier is None or not levels:
        return len(mesh.polygons) >= SHADED_FACES and mesh.normals_domain != "FACE"
    faces = len(mesh.loops) * 4 ** (levels - 1)
    if 0 < faces < SUBDIVIDED_FACES and modifier.use_limit_surface:
        faces += IRREGULAR_FACES * modifier.quality * _irregular_points(mesh)
    return faces >= SUBDIVIDED_FACES


def _irregular_points(mesh: bpy.types.Mesh) -> float:
    """Number of points of a mesh that OpenSubdiv isolates from the regular patches of its limit surface, creases among
    them. A point of many edges or corners counts as several: the patches around one grow in number and in size."""
    valences = np.bincount(stored(mesh.attributes[".edge_verts"].data, *LAYOUTS["INT32_2D"]).ravel())
    corners = np.diff(stored(mesh.polygons, np.int32), append=len(mesh.loops))
    creases = [stored(mesh.attributes[name].data, *LAYOUTS["FLOAT"]) for name in CREASES if name in mesh.attributes]
    points = sum(np.sum((values[values != 4] / 4) ** 2.5) for values in (valences, corners))
    return points + sum(np.count_nonzero(values) for values in creases)


def _plain_mesh(mesh: bpy.types.Mesh) -> dict[str, Any]:
    attributes = [
        {
            "name": attribute.name,
            "type": attribute.data_type,
            "domain": attribute.domain,
            "values": stored(attribute.data, *LAYOUTS[attribute.data_type]),
        }
        for attribute in mesh.attributes
        if attribute.data_type in LAYOUTS and (attribute.name in TOPOLOGY or not attribute.name.startswith("."))
    ]
    colors = mesh.color_attributes
    return {
        "name": mesh.name,
        "vertices": len(mesh.vertices),
        "edges": len(mesh.edges),
        "face_starts": stored(mesh.polygons, np.int32),
        "attributes": attributes,
        "uv_map": next((layer.name for layer in mesh.uv_layers if layer.active_render), None),
        "color": colors[colors.render_color_index].name if len(colors) else None,
        "texture_space": [list(mesh.texspace_location), list(mesh.texspace_size)],
    }


def _build(mesh: bpy.types.Mesh, late: dict[str, Any]) -> None:
    corners = next(
        len(description["values"]) for description in late["attributes"] if description["name"] == ".corner_vert"
    )
    mesh.vertices.add(late["vertices"])
    mesh.edges.add(late["edges"])
    mesh.loops.add(corners)
    mesh.polygons.add(len(late["face_starts"]))
    mesh.polygons.foreach_set("loop_start", late["face_starts"])
    for description in late["attributes"]:
        attribute = mesh.attributes.get(description["name"])
        attribute = attribute or mesh.attributes.new(description["name"], description["type"], description["domain"])
        stored(attribute.data, *LAYOUTS[description["type"]], is_new=True)[...] = description["values"]
    mesh.update()
    for layer in mesh.uv_layers:
        layer.active_render = layer.name == late["uv_map"]
    if late["color"] is not None:
        mesh.color_attributes.render_color_index = mesh.color_attributes.find(late["color"])
    mesh.use_auto_texspace = False
    mesh.texspace_location, mesh.texspace_size = late["texture_space"]
