"""Panoramic cameras beside Cycles: pixel by pixel, of what a room of many colours emits."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

from cards import node
from helpers import add, add_light, add_material, both_lit

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 64
PANORAMAS = {
    "EQUIRECTANGULAR": {"longitude_min": -2.0, "longitude_max": 3.0, "latitude_min": -1.2, "latitude_max": 0.9},
    "EQUIANGULAR_CUBEMAP_FACE": {},
    "MIRRORBALL": {},
    "FISHEYE_EQUIDISTANT": {"fisheye_fov": 3.5},
    "FISHEYE_EQUISOLID": {"fisheye_fov": 2.5, "fisheye_lens": 10.5},
    "FISHEYE_LENS_POLYNOMIAL": {"fisheye_fov": 2.2},
    "CENTRAL_CYLINDRICAL": {
        "central_cylindrical_range_u_min": -1.5,
        "central_cylindrical_range_u_max": 2.5,
        "central_cylindrical_range_v_min": -0.7,
        "central_cylindrical_range_v_max": 1.2,
        "central_cylindrical_radius": 1.3,
    },
}


@pytest.fixture
def room(scene):
    """A cube around a turned camera, whose walls emit colours that differ from place to place."""
    material, tree, output = add_material("Room")
    place = node(tree, "ShaderNodeTexCoord").outputs["Object"]
    color = node(tree, "ShaderNodeVectorMath", {0: place, 1: (0.25, 0.25, 0.25)}, operation="ADD").outputs[0]
    scaled = node(tree, "ShaderNodeVectorMath", {0: color, 1: (0.4, 0.3, 0.5)}, operation="MULTIPLY").outputs[0]
    shown = node(tree, "ShaderNodeVectorMath", {0: scaled}, operation="ABSOLUTE").outputs[0]
    glow = node(tree, "ShaderNodeEmission", {"Color": shown})
    tree.links.new(glow.outputs[0], output.inputs["Surface"])
    corners = [(x, y, z) for x in (-2, 2) for y in (-3, 3) for z in (-1.5, 2.5)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new("Room")
    mesh.from_pydata(corners, [], faces)
    mesh.materials.append(material)
    add(scene, "Room", mesh)
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.location, camera.rotation_euler = (0.2, -0.4, 0.1), Euler((1.3, 0.2, 0.5))
    camera.data.type = "PANO"
    render.resolution_x, render.resolution_y = 32, 24
    cycles.pixel_filter_type = "BOX"
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    return scene


def both(scene, folder):
    """RGBA by Relume and by Cycles."""
    scene.render.image_settings.color_mode = "RGBA"
    ours, theirs = both_lit(scene, folder, SAMPLES, channels=4)
    return ours[::-1], theirs[::-1]


@pytest.mark.parametrize("kind", PANORAMAS)
def test_each_pixel_is_that_of_cycles(room, kind, tmp_path):
    data = room.camera.data
    try:
        data.panorama_type = kind
    except TypeError:
        pytest.skip("not in this version")
    for name, value in PANORAMAS[kind].items():
        setattr(data, name, value)
    data.shift_x = 0.2
    ours, theirs = both(room, tmp_path / "bake")
    # At the rim of a lens a pixel is mixed of light and nothing.
    differing = np.abs(ours - theirs).max(axis=-1) > 0.05
    assert np.mean(differing) < 0.01 and np.abs(ours - theirs).mean() < 0.005, np.abs(ours - theirs).max()


def test_depth_of_field_and_clipping_are_those_of_cycles(room, tmp_path):
    data = room.camera.data
    data.panorama_type, data.fisheye_fov = "FISHEYE_EQUIDISTANT", 3.0
    data.dof.use_dof, data.dof.focus_distance, data.dof.aperture_fstop = True, 1.0, 0.05
    data.clip_start, data.clip_end = 0.5, 3.0
    ours, theirs = both(room, tmp_path / "bake")
    assert np.abs(ours - theirs).mean() < 0.02


def test_lamps_light_a_panorama(room, tmp_path):
    grey, tree, output = add_material("Grey")
    tree.links.new(node(tree, "ShaderNodeBsdfDiffuse").outputs[0], output.inputs["Surface"])
    room.objects["Room"].data.materials[0] = grey
    room.camera.data.panorama_type = "EQUIRECTANGULAR"
    room.cycles.max_bounces = 1
    add_light(room, "POINT", location=(0.5, 1.0, 0.5), shadow_soft_size=0.3, energy=100.0)
    ours, theirs = both(room, tmp_path / "bake")
    assert ours[..., :3].mean() == pytest.approx(theirs[..., :3].mean(), rel=0.03)
