"""Fingerprints of meshes, curves and other shapes, in steps of a few milliseconds."""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterator
from typing import Any

import bpy
import numpy as np

from ...core.diff import Fingerprint
from ...export.arrays import LAYOUTS, stored
from .node_fingerprints import drawn_curves, hashed, values

SLICE_BYTES = 2**22
"""Bytes of an array that are hashed in one step."""
SLICE_VERTICES = 1000
"""Whose weights are looked at in one step: each is asked alone."""
DATA = (
    bpy.types.Mesh,
    bpy.types.Curve,
    bpy.types.MetaBall,
    bpy.types.Lattice,
    bpy.types.Curves,
    bpy.types.PointCloud,
)


def shape(data: bpy.types.ID, has_weights: bool) -> Generator[None, None, Fingerprint | None]:
    """The fingerprint of a shape; `has_weights` where an object that shows it has vertex groups."""
    if getattr(data, "is_editmode", False):  # Its arrays are empty then.
        return None
    shapes = [(block.value, block.mute) for block in _keys(data)]
    if isinstance(data, bpy.types.Mesh):
        whole = [len(data.vertices), len(data.polygons), (yield from _attributes(data)), shapes]
    else:
        whole = [values(data), shapes, (yield from _points(data))]
    weights = (yield from _weights(data)) if has_weights else []
    details = [(yield from _details(data)), (yield from _key_shapes(data)), weights]
    return {"shape": hashed(whole), "details": hashed(details)}


def _keys(data: Any) -> list:
    keys = getattr(data, "shape_keys", None)
    return list(keys.key_blocks) if keys else []


def _points(data: Any) -> Generator[None, None, list]:
    """Control points of curves and metaballs."""
    splines: list[Any] = []
    while len(splines) < len(getattr(data, "splines", ())):
        spline = data.splines[len(splines)]
        splines.append([tuple(point.co) for point in (spline.bezier_points or spline.points)])
        yield
    return [splines, [tuple(element.co) for element in getattr(data, "elements", ())]]


def _details(data: Any) -> Generator[None, None, list]:
    """Data besides points that shape curves, metaballs, lattices, hair and point clouds."""
    if isinstance(data, bpy.types.Mesh):
        return []
    if isinstance(data, (bpy.types.Curves, bpy.types.PointCloud)):
        return (yield from _attributes(data))
    if isinstance(data, bpy.types.Lattice):
        return [(yield from _array(data.points, "co_deform", 3))]
    if isinstance(data, bpy.types.MetaBall):
        return [values(element) for element in data.elements]
    splines: list[Any] = []
    while len(splines) < len(data.splines):
        splines.append(_spline(data.splines[len(splines)]))
        yield
    letters = [values(letter) for letter in getattr(data, "body_format", ())]
    return [splines, letters, drawn_curves(data)]


def _spline(spline: bpy.types.Spline) -> list:
    if spline.type == "BEZIER":
        points, parts = spline.bezier_points, {"handle_left": 3, "handle_right": 3, "radius": 1, "tilt": 1}
    else:
        points, parts = spline.points, {"radius": 1, "tilt": 1}
    return [values(spline), [hashed(_floats(points, part, width).tobytes()) for part, width in parts.items()]]


def _key_shapes(data: Any) -> Generator[None, None, list]:
    """The coordinates of shape keys, and how they are mixed."""
    whole = [data.shape_keys.use_relative, data.shape_keys.eval_time] if _keys(data) else []
    found: list[Any] = []
    while len(found) < len(keys := _keys(data)):
        block = keys[len(found)]
        mixed = [block.vertex_group, block.relative_key.name if block.relative_key else ""]
        if isinstance(data, bpy.types.Curve):  # Of points of several kinds.
            found.append([mixed, [values(point) for point in block.data]])
        else:
            found.append([mixed, (yield from _array(block.points, "co", 3))])
        yield
    return [*whole, found]


def _weights(data: Any) -> Generator[None, None, list]:
    """The weights of vertex groups, of a mesh or lattice."""
    name = "vertices" if isinstance(data, bpy.types.Mesh) else "points"
    found = []
    for start in range(0, len(getattr(data, name)), SLICE_VERTICES):
        yield
        part = getattr(data, name)[start : start + SLICE_VERTICES]
        found.append(hashed(np.fromiter(_entries(part), np.float32).tobytes()))
    return found


def _entries(points: Any) -> Iterator[float]:
    """Point, group and weight of each entry, one number after the other."""
    for number, point in enumerate(points):
        for entry in point.groups:
            yield number
            yield entry.group
            yield entry.weight


def _attributes(data: Any) -> Generator[None, None, list]:
    arrays = []
    for name in sorted(data.attributes.keys()):
        # A dot begins what is Blender's own: selections, what is hidden while editing, and the vertices of corners.
        if not name.startswith(".") or name == ".corner_vert":
            arrays.append((name, (yield from _attribute(data, name))))
    return arrays


def _attribute(data: Any, name: str) -> Generator[None, None, str]:
    """Hash of all values of an attribute, a part at a time; empty if there is no such attribute, or no picture shows
    its type."""
    found = start = 0
    while True:
        attribute = data.attributes.get(name)
        if attribute is None or attribute.data_type not in LAYOUTS:
            return ""
        memory = stored(attribute.data, *LAYOUTS[attribute.data_type]).reshape(-1).view(np.uint8).data
        found = zlib.crc32(memory[start : start + SLICE_BYTES], found)
        yield
        start += SLICE_BYTES
        if start >= len(memory):
            return f"{found:08x}"


def _array(owner: Any, name: str, width: int) -> Generator[None, None, str]:
    """Hash of one property of all elements: copies it, then hashes a part at a time."""
    copied = _floats(owner, name, width).view(np.uint8).data
    found = 0
    for start in range(0, len(copied), SLICE_BYTES):
        yield
        found = zlib.crc32(copied[start : start + SLICE_BYTES], found)
    yield
    return f"{found:08x}"


def _floats(owner: Any, name: str, width: int) -> np.ndarray:
    copied: np.ndarray = np.empty(len(owner) * width, np.float32)
    owner.foreach_get(name, copied)
    return copied
