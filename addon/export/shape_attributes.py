"""Attributes that Cycles makes of the shape of meshes for the node Geometry: how sharp they are at each vertex, and a
random number of each part that hangs together."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np

from ..core.random_number import random_of_number
from .arrays import stored
from .materials import ISLAND, POINTINESS


def of_shape(mesh: bpy.types.Mesh, arrays: dict[str, Any], asked: Collection[str]) -> dict[str, np.ndarray]:
    """Those of the `asked` attributes that come from the shape of a mesh, as colours of corners [C, 4]."""
    found = {}
    for name, values in ((POINTINESS, _pointiness), (ISLAND, _random_of_islands)):
        if name in asked:
            edges = stored(mesh.edges, np.int32, 2)
            numbers = values(mesh, arrays["positions"], edges)
            found[name] = np.repeat(numbers[arrays["corner_verts"], None], 4, axis=1).astype(np.float32)
    return found


def _pointiness(mesh: bpy.types.Mesh, positions: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Angle between the normal of each vertex and the mean of its edges, in half turns, as a mean with its neighbours'.
    Vertices in the same place count as one."""
    count = len(positions)
    _, first, place = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    original = first[place.reshape(-1)]
    normals = np.zeros((count, 3))
    np.add.at(normals, original, stored(mesh.vertex_normals, np.float32, 3))
    normals = _unit(normals)
    ends = np.unique(np.sort(original[edges], axis=1), axis=0)
    along = _unit(positions[ends[:, 1]].astype(np.float64) - positions[ends[:, 0]])
    directions = np.zeros((count, 3))
    np.add.at(directions, ends[:, 0], along)
    np.add.at(directions, ends[:, 1], -along)
    edge_counts = np.bincount(ends.reshape(-1), minlength=count)
    cosines = (normals * directions).sum(axis=1) / np.maximum(edge_counts, 1)
    sharp = np.where(edge_counts > 0, np.arccos(np.clip(cosines, -1.0, 1.0)) / np.pi, 0.0)
    sums = sharp.copy()
    np.add.at(sums, ends[:, 0], sharp[ends[:, 1]])
    np.add.at(sums, ends[:, 1], sharp[ends[:, 0]])
    return (sums / (edge_counts + 1))[original]


def _unit(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)


def _random_of_islands(_mesh: bpy.types.Mesh, positions: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Number in 0..1 by the vertex that stands for each island where edges are joined one by one, the smaller tree
    below the larger."""
    parents, ranks = list(range(len(positions))), [0] * len(positions)

    def root(vertex: int) -> int:
        while parents[vertex] != vertex:
            parents[vertex] = vertex = parents[parents[vertex]]
        return vertex

    for a, b in edges.tolist():
        above, below = root(a), root(b)
        if above == below:
            continue
        if ranks[above] < ranks[below]:
            above, below = below, above
        parents[below] = above
        ranks[above] += ranks[above] == ranks[below]
    roots = [root(vertex) for vertex in range(len(positions))]
    numbers = {vertex: random_of_number(vertex, 1) for vertex in set(roots)}
    return np.array([numbers[vertex] for vertex in roots])
