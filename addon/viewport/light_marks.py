"""Rings where the lights are: the picture hides Blender's own drawing of them, but they are to be found and clicked."""

from __future__ import annotations

from collections.abc import Iterable

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from .camera_frame import camera_of
from .overlay import DIFFERENCE, Show

RADIUS_POINTS = 6.0
CORNERS = 16
SHADE = (0.0, 0.0, 0.0, 0.6)
PLAIN = (1.0, 1.0, 1.0, 0.8)
"""Colour of lights that are not selected: Blender's own black would be lost on a dark picture."""


def lights_of(context: bpy.types.Context) -> list[bpy.types.Object]:
    """The lights that Blender itself would draw in a 3D view."""
    space = context.space_data
    if not (space.overlay.show_overlays and space.overlay.show_extras and space.show_object_viewport_light):
        return []
    return [obj for obj in context.view_layer.objects if obj.type == "LIGHT" and obj.visible_in_viewport_get(space)]


def places_of(lights: Iterable[bpy.types.Object], region_data: bpy.types.RegionView3D, content: Show) -> np.ndarray:
    """Pixels of the region, [lights, 2]; NaN where a light is not in front of the picture."""
    points = np.array([(*light.matrix_world.translation, 1.0) for light in lights], np.float64).reshape(-1, 4)
    clip = points @ np.array(region_data.perspective_matrix).T
    with np.errstate(divide="ignore", invalid="ignore"):
        places = (clip[:, :2] / clip[:, 3:] + 1.0) / 2.0 * content.region
    low, high = (content.drawn.left, content.drawn.bottom), (content.drawn.right, content.drawn.top)
    inside = (clip[:, 3] > 0.0) & (places >= low).all(axis=1) & (places <= high).all(axis=1)
    return np.where(inside[:, None], places, np.nan)


def draw(context: bpy.types.Context, content: Show, scale: float) -> None:
    """Draws a ring for each light in front of the picture."""
    lights = lights_of(context)
    camera = camera_of(context.scene, context.space_data)
    # The view's own projection, which places the rings, is not that of a panorama.
    is_panorama = camera is not None and camera.data.type == "PANO"
    if not lights or content.mode == DIFFERENCE or is_panorama:
        return
    places = places_of(lights, context.region_data, content)
    is_inside = np.isfinite(places[:, 0])
    if not is_inside.any():
        return
    colors = np.array([_color(context, light) for light in lights], np.float32)[is_inside]
    blend = gpu.state.blend_get()
    gpu.state.blend_set("ALPHA")
    for radius, paint in ((RADIUS_POINTS + 1.0, np.broadcast_to(SHADE, colors.shape)), (RADIUS_POINTS, colors)):
        rings(places[is_inside], radius * scale, paint)
    gpu.state.blend_set(blend)


def _color(context: bpy.types.Context, light: bpy.types.Object) -> tuple[float, float, float, float]:
    if not light.select_get(view_layer=context.view_layer):
        return PLAIN
    theme = context.preferences.themes[0].view_3d
    active = context.view_layer.objects.active == light
    return (*(theme.object_active if active else theme.object_selected)[:3], 1.0)


def rings(places: np.ndarray, radius: float, colors: np.ndarray, corners: int = CORNERS) -> None:
    """Draws thin rings around pixels [rings, 2], in colours [rings, 4]; blending is up to the caller."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    outline = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = np.stack([outline[:-1], outline[1:]], axis=1).reshape(-1, 2)
    points = np.zeros((len(places), len(ends), 3), np.float32)
    points[..., :2] = places[:, None] + ends
    shader = gpu.shader.from_builtin("FLAT_COLOR")
    paint = np.repeat(colors, len(ends), axis=0).astype(np.float32)
    batch_for_shader(shader, "LINES", {"pos": points.reshape(-1, 3), "color": paint}).draw(shader)
