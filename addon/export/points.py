"""Point clouds as spheres."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import bpy
import numpy as np

from .arrays import stored
from .attributes import attribute_colors
from .curves import Move
from .materials import FACTOR

DEFAULT_RADIUS = 0.01
"""Radius of points that have none, metres."""


class PointsExporter:
    """Exports each point cloud once and remembers its number."""

    def __init__(self, builder: Any, attribute_names: Collection[str]):
        self.builder = builder
        self.attribute_names = attribute_names
        self.known: dict[int, tuple[int, set[str]] | None] = {}
        """Numbers of point clouds, and names of attributes that materials can read, by addresses."""

    def of_cloud(self, obj: bpy.types.Object, move: Move) -> tuple[int, set[str]] | None:
        """Number of the point cloud of an evaluated object, and names of its attributes; None without points."""
        key = obj.data.as_pointer()
        if key not in self.known:
            self.known[key] = self._add(obj, move) if len(obj.data.points) else None
        return self.known[key]

    def _add(self, obj: bpy.types.Object, move: Move) -> tuple[int, set[str]] | None:
        arrays = points_arrays(obj.data, self.attribute_names)
        positions, radii = arrays["positions"], arrays["radii"]
        bad = ~(np.isfinite(positions).all(axis=1) & np.isfinite(radii))
        if bad.any():
            positions[bad], radii[bad] = 0.0, 0.0
            self.builder.warn(f"object '{obj.name}': {bad.sum()} points that are no numbers are left out")
        np.maximum(radii, 0.0, out=radii)
        try:
            motion = move(places_of_points(arrays), obj.data.attributes)
            number = self.builder.add_points(obj.data.name, **arrays, **motion)
        except ValueError as error:
            self.builder.warn(f"object '{obj.name}': {error}; left out")
            return None
        return number, {name.removesuffix(FACTOR) for name in (*arrays["attributes"], *arrays["uv_maps"])}


def places_of_points(arrays: dict[str, Any]) -> np.ndarray:
    """Centres and radii of points, [N, 4]."""
    return np.column_stack([arrays["positions"], np.maximum(arrays["radii"], 0.0)])


def points_arrays(cloud: bpy.types.PointCloud, attribute_names: Collection[str] = ()) -> dict[str, Any]:
    """The arrays that `SceneBuilder.add_points` takes."""
    attributes = cloud.attributes
    positions = stored(attributes["position"].data, np.float32, 3).copy()
    radius = attributes.get("radius")
    has_radius = radius is not None and radius.data_type == "FLOAT"
    arrays: dict[str, Any] = {
        "positions": positions,
        "radii": stored(radius.data, np.float32).copy()
        if has_radius
        else np.full(len(positions), DEFAULT_RADIUS, np.float32),
        "uv_maps": {a.name: stored(a.data, np.float32, 2).copy() for a in attributes if a.data_type == "FLOAT2"},
        "attributes": {},
    }
    for name in sorted(attribute_names):
        attribute = attributes.get(name.removesuffix(FACTOR))
        colors = None if attribute is None or name in arrays["uv_maps"] else attribute_colors(attribute, name)
        if colors is not None:
            arrays["attributes"][name] = colors
    return arrays
