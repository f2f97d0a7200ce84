"""The camera frame in a 3D view lies where Blender projects the camera's corners, for every setting of both."""

import bpy
import pytest
from bpy_extras.object_utils import world_to_camera_view
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler, Vector

from addon.viewport import camera_frame
from addon.viewport.camera_frame import Rectangle

pytestmark = pytest.mark.every_version

POINTS = [Vector(p) for p in ((0, 0, 0), (0.7, 0.3, 0.5), (-0.6, 0.8, -0.4), (1.2, -0.5, 0.2))]

CAMERAS = {
    "plain": {},
    "portrait": {"resolution": (400, 900)},
    "wide": {"resolution": (2000, 300)},
    "vertical fit": {"sensor_fit": "VERTICAL", "sensor_height": 20.0},
    "horizontal fit, portrait": {"sensor_fit": "HORIZONTAL", "resolution": (400, 900)},
    "vertical fit, portrait": {"sensor_fit": "VERTICAL", "resolution": (400, 900)},
    "shift": {"shift_x": 0.2, "shift_y": -0.35},
    "pixel aspect": {"aspect": (2.0, 1.0), "shift_x": 0.1},
    "tall pixels": {"aspect": (1.0, 3.0), "shift_y": 0.1},
    "percentage": {"percentage": 37},
    "long lens": {"lens": 200.0},
    "orthographic": {"type": "ORTHO", "ortho_scale": 3.0, "shift_x": 0.25},
    "orthographic portrait": {"type": "ORTHO", "ortho_scale": 3.0, "shift_y": 0.25, "resolution": (300, 600)},
    "scaled": {"scale": (2.0, 2.0, 0.5)},
}
VIEWS = {
    "as opened": {},
    "zoomed in": {"view_camera_zoom": 25.5},
    "zoomed out": {"view_camera_zoom": -12.25},
    "panned": {"view_camera_offset": (0.21, -0.13)},
    "zoomed and panned": {"view_camera_zoom": 41.0, "view_camera_offset": (-0.4, 0.3)},
}


def set_up(scene, settings):
    settings = dict(settings)
    camera, render = scene.camera, scene.render
    camera.location, camera.rotation_euler = (1.0, -6.0, 4.0), Euler((0.95, 0.05, 0.2))
    camera.scale = settings.pop("scale", (1, 1, 1))
    render.resolution_x, render.resolution_y = settings.pop("resolution", (960, 540))
    render.pixel_aspect_x, render.pixel_aspect_y = settings.pop("aspect", (1.0, 1.0))
    render.resolution_percentage = settings.pop("percentage", 100)
    for key, value in settings.items():
        setattr(camera.data, key, value)
    bpy.context.view_layer.update()


@pytest.fixture
def opened(scene, gpu_started):
    """A 3D view that looks through the camera."""
    bpy.ops.wm.read_factory_settings(use_empty=False)
    scene = bpy.context.scene
    for screen in bpy.data.screens:
        for area in screen.areas:
            if screen.name == "Layout" and area.type == "VIEW_3D":
                region = next(r for r in area.regions if r.type == "WINDOW")
                area.spaces.active.region_3d.view_perspective = "CAMERA"
                return scene, area.spaces.active, region, area.spaces.active.region_3d
    raise AssertionError("Blender's own start file has a layout with a 3D view")


def look(region_data, name):
    """Sets zoom and pan of a view as the user would."""
    region_data.view_camera_zoom, region_data.view_camera_offset = 0.0, (0.0, 0.0)
    for key, value in VIEWS[name].items():
        setattr(region_data, key, value)
    region_data.update()


@pytest.mark.parametrize("name", CAMERAS)
def test_the_frame_is_where_blender_projects_it(opened, name):
    scene, space, region, region_data = opened
    set_up(scene, CAMERAS[name])
    camera, frames = camera_frame.camera_of(scene, space), set()
    for view in VIEWS:
        look(region_data, view)
        frame = camera_frame.frame_of(scene, camera, region, region_data)
        frames.add(frame)
        for point in POINTS:
            u, v, _ = world_to_camera_view(scene, camera, point)
            expected = location_3d_to_region_2d(region, region_data, point)
            found = Vector((frame.left + u * frame.width, frame.bottom + v * frame.height))
            assert (found - expected).length < 0.02, (view, found, expected)
    assert len(frames) == len(VIEWS), "zoom and pan move the frame"


def test_a_view_of_its_own_shows_its_own_camera(opened):
    scene, space, region, region_data = opened
    other = bpy.data.objects.new("Side", bpy.data.cameras.new("Side"))
    scene.collection.objects.link(other)
    space.use_local_camera, space.camera = True, other
    assert camera_frame.camera_of(scene, space) == other
    space.use_local_camera = False
    assert camera_frame.camera_of(scene, space) == scene.camera


def test_no_frame_outside_of_the_camera_view(opened):
    scene, space, region, region_data = opened
    assert camera_frame.frame_of(scene, None, region, region_data) is None
    assert camera_frame.frame_of(scene, bpy.data.objects["Light"], region, region_data) is None
    seen = camera_frame.frame_of(scene, scene.camera, region, region_data)
    scene.camera.data.type = "PANO"
    assert camera_frame.frame_of(scene, scene.camera, region, region_data) == seen
    scene.camera.data.type = "PERSP"
    region_data.view_perspective = "PERSP"
    assert camera_frame.frame_of(scene, scene.camera, region, region_data) is None


def test_the_render_border_is_a_part_of_the_frame(scene):
    assert camera_frame.border_of(scene) == ((0.0, 0.0), (1.0, 1.0))
    render = scene.render
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.5, 0.0, 0.75
    render.use_border = True
    part = Rectangle(100, 50, 300, 150).part(*camera_frame.border_of(scene))
    assert (part.left, part.bottom, part.right, part.top) == (150, 50, 200, 125)


def test_a_frame_of_the_size_of_the_picture_snaps_to_pixels():
    assert Rectangle(10.3, 20.6, 74.4, 68.4).snapped((64, 48)) == Rectangle(10, 21, 74, 69)
    assert Rectangle(10.3, 20.6, 75.4, 68.4).snapped((64, 48)) is None
    assert Rectangle(10.3, 20.6, 42.3, 44.6).snapped((64, 48)) is None
