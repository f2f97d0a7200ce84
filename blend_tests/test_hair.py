"""Hair shaders and what nodes tell of hair and points, beside Cycles."""

import bpy
import numpy as np
import pytest
import relume
from test_strands import add_cloud, add_strands, bent_strands

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import Cards, differences, node
from helpers import add_light, add_material, render_cycles

pytestmark = pytest.mark.every_version

LIGHTS = {"front": (0.0, 0.0, 0.0), "side": (1.3, 0.0, 0.0), "behind": (2.7, 0.3, 0.0)}
"""Turns of a sun over hair that is seen from above."""
HAS_MENDED_HUANG = bpy.app.version >= (4, 5, 0)
"""Before, Cycles' evaluation of that model had errors that Relume has not."""


def hair(name, kind, inputs=None, **settings):
    """A material of one hair shader."""
    material, tree, output = add_material(name)
    shader = node(tree, kind, inputs, **settings)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def add_tuft(scene, material, shape="RIBBONS"):
    """Hair seen from above, each strand a few pixels wide."""
    scene.cycles_curves.shape = shape
    strands = add_strands(scene, bent_strands(60), radius=0.03, material=material)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    scene.cycles.pixel_filter_type = "BOX"
    return strands


def pictures(scene, tmp_path, samples=256):
    """Relume's picture and Cycles', under the lights of the scene."""
    loaded = load_scene(scene)
    settings = trace_settings(scene, lambda _: None) | {"samples": 2 * samples}
    relume.bake(loaded, tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(loaded.lights(), denoise=False)["combined"][::-1]
    return ours, render_cycles(scene, samples=samples)


def assert_as_bright(scene, tmp_path, tolerance=0.02):
    """The means of both pictures agree."""
    ours, cycles = (picture.mean(axis=(0, 1)) for picture in pictures(scene, tmp_path))
    assert cycles.max() > 0.005
    assert np.abs(ours - cycles).max() < tolerance * cycles.max(), (ours, cycles)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("model", ["CHIANG", "HUANG"] if HAS_MENDED_HUANG else ["CHIANG"])
def test_tufts_of_melanin_are_as_bright_as_in_cycles(scene, tmp_path, model, light):
    settings = {"model": model, "parametrization": "MELANIN"}
    inputs = {"Melanin": 0.35, "Melanin Redness": 0.4, "Roughness": 0.35, "Random Color": 0.5}
    add_tuft(scene, hair("Melanin", "ShaderNodeBsdfHairPrincipled", inputs, **settings))
    sun = add_light(scene, "SUN", energy=3.0, angle=0.5)
    sun.rotation_euler = LIGHTS[light]
    assert_as_bright(scene, tmp_path, 0.02 if model == "CHIANG" else 0.04)


@pytest.mark.parametrize("component", ["Reflection", "Transmission"])
def test_lobes_of_hair_are_as_bright_as_in_cycles(scene, tmp_path, component):
    inputs = {"RoughnessU": 0.3, "RoughnessV": 0.5, "Offset": 0.1}
    add_tuft(scene, hair("Lobe", "ShaderNodeBsdfHair", inputs, component=component))
    sun = add_light(scene, "SUN", energy=3.0, angle=0.3)
    sun.rotation_euler = LIGHTS["front" if component == "Reflection" else "behind"]
    assert_as_bright(scene, tmp_path, 0.03)


def test_hair_shaders_on_meshes_are_as_bright_as_in_cycles(scene, tmp_path):
    cards = Cards(scene)
    for pigment in ("ABSORPTION", "MELANIN", "COLOR"):
        tree, output = cards.add(pigment)
        shader = node(tree, "ShaderNodeBsdfHairPrincipled", model="CHIANG", parametrization=pigment)
        cards.show(tree, output, shader.outputs[0])
    place = scene.objects["MELANIN"].location
    sun = add_light(scene, "SUN", "Sun", (place.x, place.y, 3.0), energy=3.0, angle=1.0)
    sun.rotation_euler = (0.0, 0.5, 0.0)
    means, warnings = cards.means(tmp_path, samples=512)
    assert not differences(means, tolerance=0.05) and not warnings


@pytest.mark.parametrize("output", ["Is Strand", "Intercept", "Length", "Thickness", "Tangent Normal", "Random"])
def test_what_hair_info_tells_is_what_it_tells_in_cycles(scene, tmp_path, output):
    material, tree, target = add_material("Told")
    emission = node(tree, "ShaderNodeEmission")
    tree.links.new(node(tree, "ShaderNodeHairInfo").outputs[output], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], target.inputs["Surface"])
    add_tuft(scene, material)
    ours, cycles = pictures(scene, tmp_path, samples=64)
    assert cycles.max() > 0.01
    assert np.abs(ours - cycles).mean() < 0.03 * cycles.mean() + 1e-4
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02)


@pytest.mark.parametrize("output", ["Position", "Radius", "Random"])
def test_what_point_info_tells_is_what_it_tells_in_cycles(scene, tmp_path, output):
    material, tree, target = add_material("Told")
    emission = node(tree, "ShaderNodeEmission")
    tree.links.new(node(tree, "ShaderNodePointInfo").outputs[output], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], target.inputs["Surface"])
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    scene.render.resolution_x = scene.render.resolution_y = 16
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    positions = np.random.default_rng(3).uniform(0.0, 1.0, (12, 3))
    add_cloud(scene, positions, np.linspace(0.1, 0.3, 12), material)
    ours, cycles = pictures(scene, tmp_path, samples=64)
    assert cycles.max() > 0.01
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02)
