"""Exported cameras project as Blender's do."""

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Euler, Vector

from addon.export.camera import UnsupportedCameraError
from helpers import add, add_quad, affine, exported

pytestmark = pytest.mark.every_version

SETTINGS = {
    "plain": {},
    "portrait": {"resolution": (40, 90)},
    "vertical fit": {"sensor_fit": "VERTICAL", "sensor_height": 20.0},
    "horizontal fit, portrait": {"sensor_fit": "HORIZONTAL", "resolution": (40, 90)},
    "shift": {"shift_x": 0.2, "shift_y": -0.35},
    "pixel aspect": {"aspect": (2.0, 1.0), "shift_x": 0.1},
    "tall pixels": {"aspect": (1.0, 3.0), "shift_y": 0.1},
    "percentage": {"percentage": 50},
    "orthographic": {"type": "ORTHO", "ortho_scale": 3.0, "shift_x": 0.25},
    "orthographic portrait": {"type": "ORTHO", "ortho_scale": 3.0, "shift_y": 0.25, "resolution": (30, 60)},
    "scaled": {"scale": (2.0, 2.0, 0.5)},
}


@pytest.mark.parametrize("name", SETTINGS)
def test_points_project_to_the_same_pixel(scene, name):
    settings = dict(SETTINGS[name])
    camera, render = scene.camera, scene.render
    camera.location, camera.rotation_euler = (1.0, -4.0, 3.0), Euler((0.9, 0.1, 0.3))
    camera.scale = settings.pop("scale", (1, 1, 1))
    render.resolution_x, render.resolution_y = settings.pop("resolution", (96, 54))
    render.pixel_aspect_x, render.pixel_aspect_y = settings.pop("aspect", (1.0, 1.0))
    render.resolution_percentage = settings.pop("percentage", 100)
    for key, value in settings.items():
        setattr(camera.data, key, value)
    add_quad(scene)
    out = exported(scene)["camera"]
    assert (out["width"], out["height"]) == (
        render.resolution_x * render.resolution_percentage // 100,
        render.resolution_y * render.resolution_percentage // 100,
    )
    low, high = np.array(out["window_min"]), np.array(out["window_max"])
    camera_from_world = affine(out["world_from_camera"]).inverted()
    for point in (Vector((0, 0, 0)), Vector((0.7, 0.3, 0.5)), Vector((-0.6, 0.8, -0.4))):
        p = camera_from_world @ point
        film = np.array([p.x, p.y]) / (-p.z if out["projection"] == "perspective" else 1.0)
        found = (film - low) / (high - low)
        expected = world_to_camera_view(scene, camera, point)
        pixels = (found - np.array(expected.xy)) * (out["width"], out["height"])
        assert np.abs(pixels).max() < 0.01, pixels


def test_depth_of_field_follows_the_focus_object(scene):
    target = add(scene, "Target", None)
    target.location = (1.0, 2.0, 1.5)
    dof = scene.camera.data.dof
    dof.use_dof, dof.focus_object, dof.aperture_fstop = True, target, 2.0
    dof.aperture_blades, dof.aperture_ratio = 6, 2.0
    add_quad(scene)
    out = exported(scene)["camera"]["depth_of_field"]
    assert out["focus_distance"] == pytest.approx(3.5)
    assert out["aperture_radius"] == pytest.approx(0.050 / 4)
    assert (out["blades"], out["ratio"]) == (6, 2.0)


def test_another_camera_is_chosen_by_name(scene):
    other = add(scene, "Side", bpy.data.cameras.new("Side"))
    other.location = (9, 0, 0)
    add_quad(scene)
    assert exported(scene, camera="Side")["camera"]["name"] == "Side"
    assert exported(scene, resolution_percentage=50)["camera"]["width"] == 32


def test_what_cannot_be_is_refused_by_name(scene):
    add_quad(scene)
    with pytest.raises(Exception, match="camera 'Nope' is not in the scene; its cameras are: Camera"):
        exported(scene, camera="Nope")
    if bpy.app.version >= (5, 0, 0):
        scene.camera.data.type = "CUSTOM"
        with pytest.raises(UnsupportedCameraError, match="camera 'Camera': custom projection is not supported"):
            exported(scene)
