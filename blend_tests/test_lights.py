"""Every light type reaches the native scene with Cycles' meaning."""

import math

import bpy
import numpy as np
import pytest

from addon.engine.reading.scene import load_scene
from helpers import add, add_light, add_material, add_quad, exported, render_cycles

pytestmark = pytest.mark.every_version

VERSION = bpy.app.version
# Light settings, and whether they need Blender 4.5.
CASES = {
    "point": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": False}),
    "point soft": ("POINT", {"shadow_soft_size": 0.3, "use_soft_falloff": True}),
    "sun": ("SUN", {"angle": 0.5, "energy": 3.0}),
    "square": ("AREA", {"shape": "SQUARE", "size": 1.5}),
    "rectangle": ("AREA", {"shape": "RECTANGLE", "size": 2.0, "size_y": 0.5}),
    "disk": ("AREA", {"shape": "DISK", "size": 1.0}),
    "ellipse": ("AREA", {"shape": "ELLIPSE", "size": 1.0, "size_y": 2.0}),
    "point, 4.5": ("POINT", {"shadow_soft_size": 0.3, "normalize": False, "exposure": 1.0, "use_soft_falloff": False}),
    "area, 4.5": ("AREA", {"size": 2.0, "normalize": False, "use_temperature": True, "temperature": 3000.0}),
    "sun, 4.5": ("SUN", {"angle": 1.0, "normalize": False}),
}


def irradiance_over_pi(light):
    """Irradiance over pi of an unoccluded light right above the origin, by closed forms of the shapes, all along z."""
    shape, radiance = light["shape"], np.array(light["radiance"])
    if shape["type"] == "sun":
        return radiance * math.sin(shape["half_angle"]) ** 2
    height = shape["center"][2]
    if shape["type"] == "sphere":
        return radiance * (shape["radius"] / height) ** 2
    if shape["type"] == "facing_disk":
        return radiance * shape["radius"] ** 2 / (height**2 + shape["radius"] ** 2)
    u, v = (np.linalg.norm(shape[edge]) / 2 for edge in ("edge_u", "edge_v"))
    steps = (np.arange(400) + 0.5) / 200 - 1
    x, y = np.meshgrid(steps * u, steps * v)
    inside = 1.0 if shape["type"] == "quad" else (x / u) ** 2 + (y / v) ** 2 < 1
    form = inside * height**2 / (x**2 + y**2 + height**2) ** 2
    return radiance * form.mean() * 4 * u * v / math.pi


@pytest.mark.parametrize("name", CASES)
def test_radiance_matches_a_cycles_probe(scene, name):
    kind, settings = CASES[name]
    if name.endswith("4.5") and VERSION < (4, 5, 0):
        pytest.skip("the setting exists from Blender 4.5 on")
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=100.0, material=material)
    add_light(scene, kind, **{"color": (1.0, 0.5, 0.25), **settings})
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 0.05
    scene.render.resolution_x = scene.render.resolution_y = 8
    expected = irradiance_over_pi(exported(scene)["lights"][0])
    found = render_cycles(scene, samples=256, max_bounces=0).mean(axis=(0, 1))
    assert found == pytest.approx(expected, rel=5e-3)


def test_spot_keeps_its_cone(scene):
    add_quad(scene)
    spot = add_light(scene, "SPOT", spot_size=1.0, spot_blend=0.25, shadow_soft_size=0.2)
    spot.rotation_euler = (math.pi / 2, 0, 0)
    shape = exported(scene)["lights"][0]["shape"]
    assert shape["type"] == "spot" and shape["soft_falloff"]
    assert (shape["half_angle"], shape["blend"]) == (0.5, 0.25)
    assert shape["axis"] == pytest.approx([0, 1, 0], abs=1e-6)


def test_a_light_whose_parent_is_stretched(scene):
    add_quad(scene)
    rig = add(scene, "Rig", None)
    rig.scale = (1.5, 0.5, 1.0)
    for kind in ("AREA", "SPOT"):
        light = add_light(scene, kind, kind.title())
        light.rotation_euler, light.parent = (0.3, 0.8, 0.2), rig
    out = exported(scene)
    area, spot = (light["shape"] for light in out["lights"])
    assert (area["type"], spot["type"]) == ("sheared", "stretched_spot")
    assert [said.partition(":")[0] for said in out["warnings"]] == ["light 'Area'", "light 'Spot'"]
    assert all("sheared" in said for said in out["warnings"])
    x, y, z = (np.array(axis) for axis in bpy.data.objects["Area"].matrix_world.to_3x3().col)
    assert np.abs(area["facing"] @ z) == pytest.approx(np.linalg.norm(z))
    assert np.linalg.norm(area["edge_u"]) == pytest.approx(np.linalg.norm(x) * bpy.data.lights["Area"].size)


def test_a_flat_light_is_named(scene):
    add_quad(scene)
    light = add_light(scene, "SPOT", "Key")
    light.rotation_euler, light.parent = (0.3, 0.8, 0.2), add(scene, "Rig", None)
    light.parent.scale = (1.0, 0.0, 1.0)
    out = exported(scene)
    assert out["lights"] == [] and any("'Key'" in said and "flat; left out" in said for said in out["warnings"])


def test_small_lights_keep_the_size_that_the_camera_sees(scene):
    add_quad(scene)
    add_light(scene, "POINT", "Pin", location=(0, 0, 2), shadow_soft_size=0.0)
    add_light(scene, "AREA", "Dot", location=(0, 0, 2), shape="SQUARE", size=0.004)
    scene.camera.location = (0, 0, 4)
    out = exported(scene)
    pin, dot = (light["shape"] for light in out["lights"])
    assert 0.0005 < pin["radius"] <= 0.002 and np.linalg.norm(dot["edge_u"]) == pytest.approx(0.004)
    assert out["warnings"] == []


def test_area_light_emits_along_its_local_minus_z(scene):
    add_quad(scene)
    light = add_light(scene, "AREA", shape="RECTANGLE", size=2.0, size_y=1.0, spread=1.0)
    light.rotation_euler, light.scale = (0.3, 0.8, 0.2), (1.0, -3.0, 1.0)
    shape = exported(scene)["lights"][0]["shape"]
    normal = np.cross(shape["edge_u"], shape["edge_v"])
    axis = np.array(light.matrix_world.to_3x3().col[2])
    assert normal @ -axis > 0.99 * np.linalg.norm(normal) * np.linalg.norm(axis)
    assert np.linalg.norm(shape["edge_v"]) == pytest.approx(3.0)
    assert shape["spread"] == pytest.approx(1.0)


def test_ray_visibility_becomes_lobe_factors(scene):
    add_quad(scene)
    light = add_light(scene, "POINT", diffuse_factor=0.1)
    light.visible_camera, light.visible_glossy = True, False
    lobes = exported(scene)["lights"][0]["lobes"]
    assert lobes == {"camera": 1, "diffuse": 1, "glossy": 0, "transmission": 1, "volume": 1}


def test_emission_node_tints_and_textures_are_named(scene):
    add_quad(scene)
    for name in ("Tinted", "Gobo"):
        light = add_light(scene, "POINT", name=name, color=(1, 1, 1)).data
        if VERSION < (5, 2, 0):
            light.use_nodes = True
        emission = next(node for node in light.node_tree.nodes if node.bl_idname == "ShaderNodeEmission")
        emission.inputs["Color"].default_value = (0.5, 0.25, 1.0, 1.0)
        emission.inputs["Strength"].default_value = 2.0
        if name == "Gobo":
            texture = light.node_tree.nodes.new("ShaderNodeTexChecker")
            light.node_tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    out = exported(scene)
    (light,) = out["lights"]
    assert light["name"] == "Tinted"
    assert np.array(light["radiance"]) / light["radiance"][0] == pytest.approx([1.0, 0.5, 2.0])
    assert any("'Gobo'" in warning and "(Checker Texture)" in warning for warning in out["warnings"])


def test_light_linking_lists_receivers(scene):
    inside, outside = add_quad(scene, "Inside"), add_quad(scene, "Outside")
    light = add_light(scene, "POINT")
    linked = bpy.data.collections.new("Receivers")
    linked.objects.link(inside)
    light.light_linking.receiver_collection = linked
    out = exported(scene)
    receiver = {instance["name"]: instance["receiver"] for instance in out["instances"]}
    assert out["lights"][0]["receivers"]["receivers"] == [receiver["Inside"]]
    linked.collection_objects[0].light_linking.link_state = "EXCLUDE"
    receivers = exported(scene)["lights"][0]["receivers"]["receivers"]
    assert receiver["Inside"] not in receivers and receiver["Outside"] in receivers
    assert outside.name == "Outside"


def test_lamps_and_cameras_that_come_and_go_leave_the_hash(scene):
    room = bpy.data.collections.new("Room")
    scene.collection.children.link(room)
    plane = add_quad(scene)
    scene.collection.objects.unlink(plane)
    room.objects.link(plane)
    before = load_scene(scene).hash
    added = [add_light(scene, "POINT"), add(scene, "Close-up", bpy.data.cameras.new("Close-up"))]
    added += [add(scene, "Radio", bpy.data.speakers.new("Radio"))]
    assert list(scene.objects).index(added[0]) < list(scene.objects).index(plane)
    assert load_scene(scene).hash == before
    for obj in added:
        bpy.data.objects.remove(obj)
    assert load_scene(scene).hash == before


def test_what_a_light_cannot_do_is_named(scene):
    add_quad(scene)
    light = add_light(scene, "POINT", name="Bare", shadow_soft_size=0.1)
    light.data.cycles.is_caustics_light = True
    portal = add_light(scene, "AREA", name="Portal")
    portal.data.cycles.is_portal = True
    out = exported(scene)
    assert [light["name"] for light in out["lights"]] == ["Bare"]
    (said,) = out["warnings"]
    assert "'Bare': shadow caustics" in said


@pytest.mark.parametrize(("degrees", "is_named"), [(0.0, True), (10.0, True), (20.0, False), (180.0, False)])
def test_a_narrow_spread_is_named(scene, degrees, is_named):
    add_quad(scene)
    add_light(scene, "AREA", name="Beam", spread=math.radians(degrees))
    said = ["'Beam': few paths find a spread below 15 degrees" in warning for warning in exported(scene)["warnings"]]
    assert said == [True] * is_named


@pytest.mark.parametrize("strength", [0.0, 2.0])
def test_emissive_meshes_are_linked(scene, strength):
    material, tree, output = add_material("Neon")
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = strength
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(scene, "Floor")
    linking = add_quad(scene, "Tube", material=material).light_linking
    linking.receiver_collection = bpy.data.collections.new("Receivers")
    linking.receiver_collection.objects.link(bpy.data.objects["Floor"])
    found = exported(scene)
    links = next(instance for instance in found["instances"] if instance["name"] == "Tube")["links"]
    assert links == ({"receivers": {"receivers": [0]}} if strength else None)


def test_instanced_lights_are_lights_of_their_own(scene):
    add_quad(scene)
    library = bpy.data.collections.new("Library")
    library.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    for index in range(3):
        empty = bpy.data.objects.new(f"Lamp{index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", library
        empty.location = (index, 0, 0)
        scene.collection.objects.link(empty)
    lights = exported(scene)["lights"]
    assert sorted(light["name"] for light in lights) == ["Bulb", "Bulb#2", "Bulb#3"]
    assert sorted(light["shape"]["center"][0] for light in lights) == [0, 1, 2]
