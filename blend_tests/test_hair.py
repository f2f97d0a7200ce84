"""Shaders of hair and what nodes tell of strands and points, beside Cycles."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import node
from helpers import add_light, add_material, add_quad, render_cycles
from strands import add_cloud, add_strands, meadow

PIXELS = 24
"""Pixels along a picture's side."""
ABOVE = 3.0
"""Height of the camera over the middle, metres."""
HAS_HUANG = pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="Huang's model is another one before Blender 4.5")


def hair_material(name, kind="ShaderNodeBsdfHairPrincipled", inputs=None, **settings):
    """A material of one node."""
    material, tree, output = add_material(name)
    shader = node(tree, kind, inputs or {}, **settings)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def telling(name, sources):
    """A material that shows sockets of nodes, three by three as colours: a list of nodes' types and outputs."""
    material, tree, output = add_material(name)
    color = node(tree, "ShaderNodeCombineXYZ")
    for channel, (kind, socket, factor) in enumerate(sources):
        scaled = node(tree, "ShaderNodeMath", {0: node(tree, kind).outputs[socket], 1: factor}, operation="MULTIPLY")
        tree.links.new(scaled.outputs[0], color.inputs[channel])
    emission = node(tree, "ShaderNodeEmission", {"Color": color.outputs[0]})
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def tuft(scene, material, x=0.0, radius=0.05, count=40):
    """Strands that stand in a row and lean to all sides."""
    random = np.random.default_rng(3)
    roots = np.column_stack((random.uniform(-0.3, 0.3, count), random.uniform(-1.0, 1.0, count), np.zeros(count)))
    steps = np.linspace(0.0, 1.0, 5)[None, :, None]
    lean = np.column_stack((random.normal(0.0, 0.1, count), random.normal(0.0, 0.4, count), np.full(count, 0.5)))
    keys = roots[:, None] + steps * lean[:, None] + steps**2 * random.normal(0.0, 0.2, (count, 1, 3))
    fur = add_strands(scene, keys, np.linspace(radius, 0.3 * radius, 5), material)
    fur.location.x = x
    return fur


def look(scene, bounces=4):
    """A view from above of three tufts side by side."""
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", 3.0
    camera.location, camera.rotation_euler = (0.0, 0.0, ABOVE), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = PIXELS
    cycles.max_bounces = bounces
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    scene.world = None


def sun(scene, name="Front", rotation=(0.5, 0.2, 0.0)):
    """A large sun, before the hair unless told otherwise."""
    made = add_light(scene, "SUN", name, energy=3.0, angle=1.0)
    made.rotation_euler = rotation
    return made


def sun_behind(scene):
    """A large sun behind the hair."""
    return sun(scene, "Behind", (2.6, 0.3, 0.0))


def lamp_beside(scene):
    """A lamp beside the hair."""
    return add_light(scene, "POINT", "Beside", (-2.5, 0.5, 1.5), energy=500.0, shadow_soft_size=1.0)


def small_lamp(scene):
    """A lamp above the hair. Of large ones, Cycles leaves out what hair reflects from behind."""
    return add_light(scene, "POINT", "Above", (0.5, 0.3, 1.5), energy=100.0, shadow_soft_size=0.2)


def thirds(image):
    """Mean colours of the left, middle and right third of a picture."""
    return image.reshape(PIXELS, 3, PIXELS // 3, 3).mean(axis=(0, 2))


def assert_thirds_are_alike(scene, tmp_path, lights, share=0.01, samples=64, own_samples=256):
    """Asserts that thirds of pictures by each light are alike, within three standard errors, which two seeds tell,
    and a share."""
    found = np.zeros((2, 2, max(len(lights), 1), 3, 3))
    for seed in (0, 1):
        scene.cycles.seed = seed
        read = load_scene(scene)
        assert read.warnings == []
        folder = tmp_path / f"bake {seed}"
        settings = trace_settings(scene, lambda _: None) | {"samples": own_samples, "seed": seed}
        relume.bake(read, folder, settings).wait()
        pictures = relume.Relighter(folder).relight(read.lights(), denoise=False)
        for number, lamp in enumerate(lights or [None]):
            for each in lights:
                each.hide_render = each != lamp
            own = pictures["combined"] if lamp is None else pictures["lights"][lamp.name]
            found[0, seed, number] = thirds(np.array(own)[::-1])
            found[1, seed, number] = thirds(render_cycles(scene, samples=samples))
        for each in lights:
            each.hide_render = False
    ours, cycles = found.mean(axis=1)
    # Means of two pictures differ from the truth by half of what the two differ by; as a share, thirds are as noisy.
    means = np.abs(found).mean(axis=1)
    errors = np.sqrt(np.square(0.5 * (found[:, 0] - found[:, 1]) / means).mean(axis=(2, 3)))
    allowed = (3.0 * np.hypot(*errors)[:, None, None] + share) * np.abs(cycles)
    assert cycles.mean(axis=(1, 2)).min() > 1e-3
    assert (np.abs(ours - cycles) <= allowed).all(), (ours.round(4).tolist(), cycles.round(4).tolist(), errors)


@pytest.mark.oldest_and_newest
def test_tufts_of_chiang_are_as_bright_as_in_cycles(scene, tmp_path):
    melanin = {"Melanin": 0.4, "Random Roughness": 0.5, "Random Color": 0.5}
    tuft(scene, hair_material("Brown", inputs=melanin, model="CHIANG", parametrization="MELANIN"), -1.0)
    coated = {"Color": (0.8, 0.4, 0.1, 1.0), "Coat": 0.5, "Radial Roughness": 0.6}
    tuft(scene, hair_material("Red", inputs=coated, model="CHIANG", parametrization="COLOR"))
    clear = {"Absorption Coefficient": (0.1, 0.2, 0.5), "Roughness": 0.5, "IOR": 1.4, "Offset": 0.1}
    tuft(scene, hair_material("Blond", inputs=clear, model="CHIANG", parametrization="ABSORPTION"), 1.0)
    look(scene)
    assert_thirds_are_alike(scene, tmp_path, [sun(scene), sun_behind(scene), lamp_beside(scene)])


@pytest.mark.oldest_and_newest
def test_ray_visibility_of_lights_on_hair_and_leaves_is_that_of_cycles(scene, tmp_path):
    tuft(scene, hair_material("Blond", inputs={"Melanin": 0.05}, model="CHIANG", parametrization="MELANIN"), -1.0)
    for name, x in (("ShaderNodeBsdfTranslucent", 0.0), ("ShaderNodeBsdfDiffuse", 1.0)):
        leaf = add_quad(scene, name, size=0.6, material=hair_material(name, name))
        leaf.location, leaf.rotation_euler = (x, 0.0, 0.1), (0.4, 0.3, 0.0)
    look(scene, bounces=0)
    found = []
    for flag in ("visible_diffuse", "visible_glossy", "visible_transmission"):
        for place in ((0.5, 0.3, 1.5), (0.0, 0.4, -1.0)):
            lamp = small_lamp(scene)
            lamp.location = place
            setattr(lamp, flag, False)
            read = load_scene(scene)
            folder = tmp_path / f"{flag} {place}"
            relume.bake(read, folder, trace_settings(scene, lambda _: None) | {"samples": 512}).wait()
            ours = relume.Relighter(folder).relight(read.lights(), denoise=False)["combined"]
            found.append((thirds(np.array(ours)[::-1]), thirds(render_cycles(scene, samples=64))))
            bpy.data.objects.remove(lamp)
    ours, cycles = np.array(found).reshape(3, 2, 2, 3, 3).mean(axis=-1).transpose(2, 0, 1, 3)
    lit = cycles.max(axis=0)
    assert (lit > 5e-4).sum() == 4  # The leaves have light from one side each.
    assert (np.abs(ours - cycles) <= 0.25 * lit + 1e-4).all(), (ours.round(4).tolist(), cycles.round(4).tolist())


@HAS_HUANG
def test_tufts_of_huang_are_as_bright_as_in_cycles(scene, tmp_path):
    melanin = {"Melanin": 0.4, "Aspect Ratio": 1.0}
    tuft(scene, hair_material("Brown", inputs=melanin, model="HUANG", parametrization="MELANIN"), -1.0)
    colored = {"Color": (0.8, 0.4, 0.1, 1.0), "Aspect Ratio": 1.0, "Roughness": 0.5}
    tuft(scene, hair_material("Red", inputs=colored, model="HUANG", parametrization="COLOR"))
    clear = {"Absorption Coefficient": (0.1, 0.2, 0.5), "Reflection": 0.5, "Secondary Reflection": 2.0}
    tuft(scene, hair_material("Blond", inputs=clear, model="HUANG", parametrization="ABSORPTION"), 1.0)
    look(scene)
    assert_thirds_are_alike(scene, tmp_path, [sun(scene), sun_behind(scene), lamp_beside(scene)])


@HAS_HUANG
def test_elliptical_hair_lies_as_its_own_normals_say(scene, tmp_path):
    material = hair_material("Flat", inputs={"Aspect Ratio": 0.2, "Melanin": 0.1}, model="HUANG")
    for x, normal in ((-1.0, (-0.6, 0.0, 0.8)), (0.0, (1.0, 0.0, 0.0)), (1.0, (0.6, 0.0, 0.8))):
        keys = np.array([[(0.05 * column, y, 0.0) for y in np.linspace(-1.4, 1.4, 4)] for column in range(-6, 7)])
        fur = add_strands(scene, keys, 0.02, material)
        fur.location.x = x
        # Turns strands, but not their normals.
        fur.rotation_euler.y = 0.5
        attributes = fur.data.attributes
        attributes.new("normal_mode", "INT8", "CURVE").data.foreach_set("value", np.full(13, 2, np.int8))
        own = attributes.new("custom_normal", "FLOAT_VECTOR", "POINT")
        own.data.foreach_set("vector", np.tile(np.array(normal, np.float32), 52))
    look(scene, bounces=0)
    # From behind, where it shines: most where the wide side is turned away.
    assert_thirds_are_alike(scene, tmp_path, [sun_behind(scene)], share=0.03, samples=256, own_samples=512)


def test_lobes_of_the_hair_bsdf_and_bumps_look_as_in_cycles(scene, tmp_path):
    lobe = {"Color": (0.8, 0.5, 0.2, 1.0), "RoughnessU": 0.3, "RoughnessV": 0.6, "Offset": 0.1}
    tuft(scene, hair_material("Lobe", "ShaderNodeBsdfHair", lobe, component="Reflection"), -1.0)
    tuft(scene, hair_material("Other lobe", "ShaderNodeBsdfHair", lobe, component="Transmission"))
    material, tree, output = add_material("Rough")
    waves = node(tree, "ShaderNodeTexWave", {"Scale": 3.0, 0: node(tree, "ShaderNodeTexCoord").outputs["Object"]})
    bump = node(tree, "ShaderNodeBump", {"Height": waves.outputs["Fac"], "Strength": 1.0})
    shader = node(tree, "ShaderNodeBsdfDiffuse", {"Color": (0.8, 0.5, 0.3, 1.0), "Normal": bump.outputs[0]})
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    tuft(scene, material, 1.0)
    look(scene, bounces=0)
    assert_thirds_are_alike(scene, tmp_path, [small_lamp(scene)], own_samples=512)


def test_nodes_tell_of_strands_and_points_what_they_tell_in_cycles(scene, tmp_path):
    info, point = "ShaderNodeHairInfo", "ShaderNodePointInfo"
    tuft(scene, telling("A", [(info, "Intercept", 1.0), (info, "Random", 1.0), (info, "Length", 1.0)]), -1.0)
    tuft(scene, telling("B", [(info, "Is Strand", 1.0), (info, "Thickness", 20.0), (info, "Tangent Normal", -3.0)]))
    random = np.random.default_rng(4)
    places = random.uniform((0.6, -1.3, 0.0), (1.4, 1.3, 0.5), (40, 3))
    sources = [(point, "Radius", 5.0), (point, "Random", 1.0), (point, "Position", 1.0)]
    add_cloud(scene, places, np.linspace(0.05, 0.2, 40), telling("C", sources))
    look(scene, bounces=0)
    assert_thirds_are_alike(scene, tmp_path, [])


@pytest.mark.oldest_and_newest
def test_hair_of_particles_with_children_is_as_bright_as_in_cycles(scene, tmp_path):
    ground = meadow(scene, count=30, brownian_factor=0.2, child_type="INTERPOLATED", rendered_child_count=4)
    material = hair_material("Fur", inputs={"Melanin": 0.3, "Random Color": 0.8}, model="CHIANG")
    ground.data.materials[1] = material
    look(scene)
    assert_thirds_are_alike(scene, tmp_path, [sun(scene)])
