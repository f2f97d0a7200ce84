"""Reads a camera object; `relume_scene::BlenderCamera` gives the numbers their meaning."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import bpy

NO_MOTION: Mapping[str, Any] = MappingProxyType({})


class UnsupportedCameraError(Exception):
    """A camera that Relume cannot take."""


class WatchedCamera:
    """Stands for an evaluated camera object while a scene is read, and notes whether anything asks for its values: a
    scene of which nothing does is the same for all cameras."""

    def __init__(self, camera: bpy.types.Object):
        self._camera = camera
        self.is_used = False

    def note_use(self) -> None:
        """Notes that something depends on which camera it is."""
        self.is_used = True

    def __getattr__(self, name: str) -> Any:
        self.note_use()
        return getattr(self._camera, name)


def film_size(render: bpy.types.RenderSettings, percentage: int | None = None) -> tuple[int, int]:
    """Width and height in pixels, rounded down as Blender does; `percentage` overrides that of the scene."""
    percentage = percentage or render.resolution_percentage
    width, height = (max(1, edge * percentage // 100) for edge in (render.resolution_x, render.resolution_y))
    return width, height


def film_border(render: bpy.types.RenderSettings) -> tuple[int, int, int, int]:
    """Left, bottom, width and height in pixels of the part of the picture that Blender renders."""
    width, height = film_size(render)
    if not render.use_border:
        return 0, 0, width, height
    left, right = int(render.border_min_x * width), int(render.border_max_x * width)
    bottom, top = int(render.border_min_y * height), int(render.border_max_y * height)
    return left, bottom, right - left, top - bottom


def why_no_picture(scene: bpy.types.Scene) -> str:
    """Reason why a scene cannot be rendered, and the way out; empty if it can."""
    render = scene.render
    if min(render.resolution_x, render.resolution_y) * render.resolution_percentage < 100:
        return f"The picture of scene '{scene.name}' has no pixels; raise the resolution or its percentage"
    if min(film_border(render)[2:]) < 1:
        return f"The render region of scene '{scene.name}' is empty; draw it anew or switch it off"
    if render.use_multiview:
        return f"Stereo views of scene '{scene.name}' are not supported; switch off Stereoscopy in the output settings"
    if not any(layer.use for layer in scene.view_layers):
        return f"No view layer of scene '{scene.name}' is rendered; switch on Use for Rendering of one"
    return ""


def camera_json(
    camera: bpy.types.Object, scene: bpy.types.Scene, size: tuple[int, int], motion: Mapping[str, Any] = NO_MOTION
) -> str:
    """The JSON form of `BlenderCamera` for an evaluated camera object, a film of `size` pixels and its motion."""
    data, render = camera.data, scene.render
    description = {
        "name": camera.name,
        "world_from_object": [list(row) for row in camera.matrix_world],
        "projection": _projection(camera),
        "resolution": list(size),
        "pixel_aspect": [render.pixel_aspect_x, render.pixel_aspect_y],
        "sensor_fit": data.sensor_fit,
        "sensor": [data.sensor_width, data.sensor_height],
        "lens": data.lens,
        "ortho_scale": data.ortho_scale,
        "shift": [data.shift_x, data.shift_y],
        "clip_start": data.clip_start,
        "clip_end": data.clip_end,
        "depth_of_field": _depth_of_field(camera) if data.dof.use_dof else None,
        **motion,
    }
    try:
        return json.dumps(description, allow_nan=False)
    except ValueError as error:
        raise UnsupportedCameraError(
            f"camera '{camera.name}': one of its values is not a finite number; set its transform and lens, or what "
            "drives them, anew"
        ) from error


def _projection(camera: bpy.types.Object) -> str | dict[str, Any]:
    """Projection in the form of `relume_scene::Projection`."""
    data = camera.data
    if data.type in PLANAR:
        return PLANAR[data.type]
    make = PANORAMAS.get(data.panorama_type) if data.type == "PANO" else None
    if make is None:
        kind = data.panorama_type if data.type == "PANO" else data.type
        raise UnsupportedCameraError(
            f"camera '{camera.name}': {kind.lower()} projection is not supported; use another type of camera"
        )
    return {"panoramic": make(data)}


def _equirectangular(data: bpy.types.Camera) -> dict[str, Any]:
    longitude, latitude = [data.longitude_min, data.longitude_max], [data.latitude_min, data.latitude_max]
    return {"equirectangular": {"longitude": longitude, "latitude": latitude}}


def _equisolid(data: bpy.types.Camera) -> dict[str, Any]:
    return {"fisheye_equisolid": {"lens": data.fisheye_lens, "fov": data.fisheye_fov}}


def _polynomial(data: bpy.types.Camera) -> dict[str, Any]:
    coefficients = [getattr(data, f"fisheye_polynomial_k{power}") for power in range(5)]
    return {"fisheye_lens_polynomial": {"coefficients": coefficients, "fov": data.fisheye_fov}}


def _cylindrical(data: bpy.types.Camera) -> dict[str, Any]:
    radius = data.central_cylindrical_radius
    longitude = [data.central_cylindrical_range_u_min, data.central_cylindrical_range_u_max]
    height = [data.central_cylindrical_range_v_min / radius, data.central_cylindrical_range_v_max / radius]
    return {"central_cylindrical": {"longitude": longitude, "height": height}}


PLANAR = {"PERSP": "perspective", "ORTHO": "orthographic"}
PANORAMAS: dict[str, Callable[[bpy.types.Camera], str | dict[str, Any]]] = {
    "EQUIRECTANGULAR": _equirectangular,
    "EQUIANGULAR_CUBEMAP_FACE": lambda _data: "equiangular_cubemap_face",
    "MIRRORBALL": lambda _data: "mirror_ball",
    "FISHEYE_EQUIDISTANT": lambda data: {"fisheye_equidistant": {"fov": data.fisheye_fov}},
    "FISHEYE_EQUISOLID": _equisolid,
    "FISHEYE_LENS_POLYNOMIAL": _polynomial,
    "CENTRAL_CYLINDRICAL": _cylindrical,
}


def _depth_of_field(camera: bpy.types.Object) -> dict[str, float]:
    dof = camera.data.dof
    return {
        "fstop": max(dof.aperture_fstop, 1e-5),
        "focus_distance": max(_focus_distance(camera), 1e-4),
        "blades": dof.aperture_blades,
        "rotation": dof.aperture_rotation,
        "ratio": dof.aperture_ratio,
    }


def _focus_distance(camera: bpy.types.Object) -> float:
    """Distance along the view axis; of the focus object, or of its bone, if one is set."""
    dof = camera.data.dof
    if dof.focus_object is None:
        return dof.focus_distance
    target = dof.focus_object.matrix_world
    bones = dof.focus_object.pose.bones if dof.focus_object.pose else {}
    if dof.focus_subtarget and dof.focus_subtarget in bones:
        target = target @ bones[dof.focus_subtarget].matrix
    view_axis = camera.matrix_world.to_3x3().col[2].normalized()
    return abs(view_axis.dot(target.translation - camera.matrix_world.translation))
