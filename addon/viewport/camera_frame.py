"""Rectangle of the camera's picture in a 3D view, exact, in pixels of the region.

The region's projection already holds zoom, pan, lens, lens shift and sensor fit, and the camera's own frame holds
resolution and pixel aspect. So the frame, projected, is right for every setting. A panorama fills the frame that a lens
would have, as Cycles draws it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
from mathutils import Matrix, Vector


@dataclass(frozen=True)
class Rectangle:
    """Pixels of a region, from its lower left corner; need not be whole numbers nor inside of the region."""

    left: float
    bottom: float
    right: float
    top: float

    @property
    def width(self) -> float:
        """Width in pixels."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Height in pixels."""
        return self.top - self.bottom

    def part(self, low: tuple[float, float], high: tuple[float, float]) -> Rectangle:
        """The part between two corners, given as fractions of width and height from the lower left."""
        return Rectangle(
            self.left + low[0] * self.width,
            self.bottom + low[1] * self.height,
            self.left + high[0] * self.width,
            self.bottom + high[1] * self.height,
        )

    def snapped(self, size: tuple[int, int]) -> Rectangle | None:
        """The rectangle of exactly `size` whole pixels, if this is less than half a pixel larger or smaller."""
        if abs(self.width - size[0]) >= 0.5 or abs(self.height - size[1]) >= 0.5:
            return None
        left, bottom = round(self.left), round(self.bottom)
        return Rectangle(left, bottom, left + size[0], bottom + size[1])


def project(corners: Iterable[Vector], window_from_camera: Matrix, size: tuple[int, int]) -> Rectangle:
    """The rectangle around points of camera space, seen in a region of `size` pixels."""
    points = []
    for corner in corners:
        x, y, _, w = window_from_camera @ corner.to_4d()
        points.append(((x / w + 1.0) / 2.0 * size[0], (y / w + 1.0) / 2.0 * size[1]))
    columns, rows = zip(*points, strict=True)
    return Rectangle(min(columns), min(rows), max(columns), max(rows))


def camera_of(scene: bpy.types.Scene, space: bpy.types.SpaceView3D) -> bpy.types.Object | None:
    """The camera that a 3D view looks through when it is in camera view."""
    return space.camera if space.use_local_camera else scene.camera


def frame_of(
    scene: bpy.types.Scene,
    camera: bpy.types.Object | None,
    region: bpy.types.Region,
    region_data: bpy.types.RegionView3D,
) -> Rectangle | None:
    """The camera's whole frame; None where the region does not look through it."""
    if region_data.view_perspective != "CAMERA" or camera is None or camera.type != "CAMERA":
        return None
    if camera.data.type == "CUSTOM":
        return None
    corners = camera.data.view_frame(scene=scene)
    return project(corners, region_data.window_matrix, (region.width, region.height))


def border_of(scene: bpy.types.Scene) -> tuple[tuple[float, float], tuple[float, float]]:
    """Corners of the part that a render covers, as fractions of the frame from the lower left."""
    render = scene.render
    if not render.use_border:
        return (0.0, 0.0), (1.0, 1.0)
    return (render.border_min_x, render.border_min_y), (render.border_max_x, render.border_max_y)
