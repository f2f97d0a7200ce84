"""The star test, small: a gather of any light equals a Cycles render of it. The real scenes are `make parity`'s."""

import math
import sys
from pathlib import Path

import bpy
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add, add_light, add_material, add_quad, background, render_cycles
from instances import instancing, unlinked

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts" / "parity"))
from compare import summary  # noqa: E402

pytestmark = pytest.mark.oldest_and_newest

LIGHTS = {
    "point": ("POINT", {"shadow_soft_size": 0.4, "use_soft_falloff": False}),
    "soft point": ("POINT", {"shadow_soft_size": 0.4, "use_soft_falloff": True}),
    "spot": ("SPOT", {"shadow_soft_size": 0.3, "spot_size": 1.4, "spot_blend": 0.4}),
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 1.2, "size_y": 0.6}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 1.2, "size_y": 0.6, "spread": 2.0}),
    "sun": ("SUN", {"angle": 0.4, "energy": 3.0}),
}


@pytest.fixture
def room(scene):
    """A floor, a wall and a glossy block, seen at an angle."""

    def surface(name, color, roughness):
        material, tree, output = add_material(name)
        node = tree.nodes.new("ShaderNodeBsdfPrincipled")
        node.inputs["Base Color"].default_value = (*color, 1.0)
        node.inputs["Roughness"].default_value = roughness
        tree.links.new(node.outputs[0], output.inputs["Surface"])
        return material

    add_quad(scene, "Floor", size=6.0, material=surface("Floor", (0.7, 0.7, 0.6), 0.8))
    wall = add_quad(scene, "Wall", size=6.0, material=surface("Wall", (0.7, 0.2, 0.1), 0.6))
    wall.location, wall.rotation_euler = (0.0, 2.0, 1.0), (math.pi / 2, 0.0, 0.0)
    bpy.ops.mesh.primitive_cube_add(size=0.8, location=(0.7, 0.3, 0.4), rotation=(0.0, 0.0, 0.5))
    block = bpy.context.object
    block.name = "Block"
    block.data.materials.append(surface("Block", (0.2, 0.4, 0.8), 0.4))
    scene.camera.location, scene.camera.rotation_euler = (0.0, -5.0, 2.5), (1.15, 0.0, 0.0)
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 4
    scene.world = bpy.data.worlds.new("Black")
    return scene


def pictures(scene, tmp_path, samples=768):
    """Gathered and by Cycles, top row first."""
    folder = tmp_path / "bake"
    settings = trace_settings(scene, lambda _: None) | {"samples": samples}
    relume.bake(load_scene(scene), folder, settings).wait()
    ours = relume.Relighter(folder).relight(denoise=False)["combined"]
    return ours, render_cycles(scene, samples=192)[::-1]


def assert_equal(ours, cycles):
    found = summary(ours, cycles)
    assert found["mean_ratio"] == pytest.approx(1.0, abs=0.015), found
    assert found["median"] < 0.02 and found["p95"] < 0.08, found


@pytest.mark.parametrize("name", LIGHTS)
def test_gather_equals_cycles(room, tmp_path, name):
    kind, settings = LIGHTS[name]
    light = add_light(room, kind, name="Key", location=(-0.6, -0.4, 1.8), **settings)
    light.rotation_euler = (0.5, 0.3, 0.0)
    assert_equal(*pictures(room, tmp_path))


STRETCHED = {
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 1.2, "size_y": 0.6}),
    "disk": ("AREA", {"shape": "DISK", "size": 0.8}),
    "spot": ("SPOT", {"shadow_soft_size": 0.2, "spot_size": 1.0, "spot_blend": 0.3}),
}


@pytest.mark.parametrize("name", STRETCHED)
def test_a_light_whose_parent_is_stretched(room, tmp_path, name):
    kind, settings = STRETCHED[name]
    light = add_light(room, kind, name="Key", location=(-0.4, -0.4, 1.8), **settings)
    light.rotation_euler = (0.5, 0.3, 0.6)
    light.parent = add(room, "Rig", None)
    light.parent.scale, light.parent.rotation_euler = (1.5, 0.7, 1.0), (0.0, 0.0, 0.4)
    assert_equal(*pictures(room, tmp_path))


def test_a_scene_in_tenths_of_millimetres(room, tmp_path):
    lamp = add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    set_up = add(room, "Set", None)
    for obj in set(room.objects) - {set_up}:
        obj.parent = set_up
    set_up.scale = (1e-4,) * 3
    lamp.data.shadow_soft_size, lamp.data.energy = 0.4e-4, lamp.data.energy * 1e-8
    room.camera.data.clip_start = 1e-6
    assert_equal(*pictures(room, tmp_path))


def test_a_light_behind_more_transparent_films_than_the_limit(room, tmp_path):
    material, tree, output = add_material("Film")
    mix, clear, matt = (tree.nodes.new(f"ShaderNode{name}") for name in ("MixShader", "BsdfTransparent", "BsdfDiffuse"))
    mix.inputs["Fac" if "Fac" in mix.inputs else "Factor"].default_value = 0.3
    for node, socket in ((clear, 1), (matt, 2)):
        tree.links.new(node.outputs[0], mix.inputs[socket])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    for number in range(4):
        film = add_quad(room, f"Film {number}", size=1.6, material=material)
        film.location, film.rotation_euler = (-0.8, -0.2 + 0.2 * number, 0.8), (1.35, 0.0, 0.0)
    add_light(room, "POINT", name="Key", location=(-1.6, -1.6, 1.8), shadow_soft_size=0.4)
    add_light(room, "POINT", name="Back", location=(-0.8, 1.4, 1.0), shadow_soft_size=0.3)
    room.cycles.transparent_max_bounces = 2
    assert_equal(*pictures(room, tmp_path))


def test_a_light_seen_by_the_camera(room, tmp_path):
    light = add_light(room, "AREA", name="Key", location=(-0.6, 0.6, 1.8), size=0.8)
    light.rotation_euler, light.visible_camera = (-0.9, 0.0, 0.0), True
    assert_equal(*pictures(room, tmp_path))


def test_light_linking_and_ray_visibility(room, tmp_path):
    light = add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    receivers = bpy.data.collections.new("Receivers")
    for name in ("Floor", "Block"):
        receivers.objects.link(bpy.data.objects[name])
    light.light_linking.receiver_collection = receivers
    light.visible_glossy = False
    assert_equal(*pictures(room, tmp_path))


def test_ray_visibility_of_what_instances(room, tmp_path):
    light = add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    for obj, ray in ((light, "visible_glossy"), (bpy.data.objects["Block"], "visible_camera")):
        for collection in obj.users_collection:
            collection.objects.unlink(obj)
        setattr(instancing(room, unlinked(obj.name, obj)), ray, False)
    assert_equal(*pictures(room, tmp_path, samples=1536))


def test_depth_of_field_and_shift(room, tmp_path):
    add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    camera = room.camera.data
    camera.shift_x, camera.dof.use_dof, camera.dof.focus_distance = 0.1, True, 4.0
    camera.dof.aperture_fstop, camera.dof.aperture_blades, camera.dof.aperture_ratio = 0.1, 5, 1.5
    assert_equal(*pictures(room, tmp_path))


def test_world_colour(room, tmp_path):
    if bpy.app.version < (5, 2, 0):
        room.world.use_nodes = True
    background(room).inputs["Color"].default_value = (0.2, 0.5, 0.9, 1.0)
    assert_equal(*pictures(room, tmp_path))


@pytest.mark.slow
def test_a_fog_box_around_the_set(room, tmp_path):
    add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    material, tree, output = add_material("Fog")
    fog = tree.nodes.new("ShaderNodeVolumeScatter")
    fog.inputs["Density"].default_value = 0.0  # So that there is nothing but the box to tell apart.
    tree.links.new(fog.outputs[0], output.inputs["Volume"])
    bpy.ops.mesh.primitive_cube_add(size=3.5, location=(0.0, 0.0, 1.5))
    bpy.context.object.data.materials.append(material)
    assert_equal(*pictures(room, tmp_path))


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="the convention of normal maps is new in Blender 5.2")
def test_a_normal_map_of_directx(room, tmp_path):
    add_light(room, "POINT", name="Key", location=(-0.6, -0.4, 1.8), shadow_soft_size=0.4)
    tree = room.objects["Floor"].data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.convention = "DIRECTX"
    node.inputs["Color"].default_value = (0.6, 0.8, 0.9, 1.0)
    surface = next(found for found in tree.nodes if found.bl_idname == "ShaderNodeBsdfPrincipled")
    tree.links.new(node.outputs[0], surface.inputs["Normal"])
    assert_equal(*pictures(room, tmp_path))
