"""3D images of points, which Blender renders for its node Point Density, up to 4.5."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Matrix, Vector

MOST_VOXELS = 256
"""Voxels along an edge up to which they are read: Blender hands out number by number, 1 GiB and 10 s for 200."""


class PointImage(NamedTuple):
    """A 3D image in the scene."""

    texture: Any
    """Number of the texture that holds its layers, one above another."""
    layers: int
    unit_from_world: Matrix
    """The box around the points as a unit cube."""


def point_image(builder: Any, node: bpy.types.Node, depsgraph: bpy.types.Depsgraph, largest: int | None) -> PointImage:
    """Adds the image of a node to a builder. Where it has more voxels along an edge than `largest`, each becomes the
    mean of a cube, as in Cycles."""
    node.cache_point_density(depsgraph=depsgraph)
    unit_from_world = _unit_from_world(node, depsgraph)  # With the values Blender forgets the bounds.
    edge = node.resolution
    values = np.array(node.calc_point_density(depsgraph=depsgraph), np.float32)
    voxels = _shrunk(values.reshape(edge, edge, edge, 4), largest)
    layers = len(voxels)
    texels = voxels.reshape(layers * layers, layers, 4)
    number = builder.add_texture(node.name, texels, encoding="linear", alpha="channel_packed")
    return PointImage(number, layers, unit_from_world)


def _unit_from_world(node: bpy.types.Node, depsgraph: bpy.types.Depsgraph) -> Matrix:
    """Along directions in which the box is flat, all is in the middle."""
    low, high = (Vector(corner) for corner in node.calc_point_density_minmax(depsgraph=depsgraph))
    scale = Vector([1.0 / size if size != 0.0 else 0.0 for size in high - low])
    to_middle = Vector([0.5, 0.5, 0.5]) - (low + high) * scale * 0.5
    return Matrix.Translation(to_middle) @ Matrix.Diagonal((*scale, 1.0)) @ node.object.matrix_world.inverted_safe()


def _shrunk(voxels: np.ndarray, largest: int | None) -> np.ndarray:
    """Voxels [z, y, x, 4] halved along each axis until there are no more than `largest`."""
    edge, cube = len(voxels), 1
    while largest is not None and edge > largest * cube:
        cube *= 2
    whole = edge // cube
    kept = voxels[: whole * cube, : whole * cube, : whole * cube]
    return kept.reshape(whole, cube, whole, cube, whole, cube, 4).mean(axis=(1, 3, 5), dtype=np.float32)
