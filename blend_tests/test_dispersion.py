"""Dispersion of Blender 5.3's glass, beside Cycles."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import node
from helpers import add_light, add_material, add_quad, render_cycles

pytestmark = [
    pytest.mark.oldest_and_newest,
    pytest.mark.skipif(bpy.app.version < (5, 3, 0), reason="this Blender has no dispersion"),
]


def prism(scene, scale, abbe_number, roughness=0.0):
    """A prism of glass above a glowing edge, seen from straight above."""
    material, tree, output = add_material("Glass")
    inputs = {"Transmission Weight": 1.0, "IOR": 1.6, "Roughness": roughness, "Base Color": (1.0, 1.0, 1.0, 1.0)}
    inputs |= {"Transmission Dispersion Scale": scale, "Transmission Dispersion Abbe Number": abbe_number}
    tree.links.new(node(tree, "ShaderNodeBsdfPrincipled", inputs).outputs[0], output.inputs["Surface"])
    mesh = bpy.data.meshes.new("Prism")
    corners = [(-1, -2, 0.5), (1, -2, 0.5), (1, -2, 1.2), (-1, 2, 0.5), (1, 2, 0.5), (1, 2, 1.2)]
    mesh.from_pydata(corners, [], [(0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2)])
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Prism", mesh))


def look_down(scene):
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.2
    camera.location, camera.rotation_euler = (0.2, 0.0, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x, render.resolution_y = 16, 4
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)


def both(scene, tmp_path, samples):
    found = load_scene(scene)
    assert found.warnings == []
    relume.bake(found, tmp_path / "bake", trace_settings(scene, lambda _: None) | {"samples": samples}).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(found.lights(), denoise=False)["combined"][::-1, :, :3]
    return ours, render_cycles(scene, samples=samples)


def test_a_strip_behind_a_prism_has_the_colours_of_cycles(scene, tmp_path):
    look_down(scene)
    prism(scene, 1.0, 10.0)
    material, tree, output = add_material("Glow")
    tree.links.new(node(tree, "ShaderNodeEmission").outputs[0], output.inputs["Surface"])
    strip = add_quad(scene, "Strip", size=1.0, material=material)
    strip.location, strip.scale, strip.visible_glossy = (0.0, 0.0, -3.0), (1.0, 8.0, 1.0), False
    ours, cycles = both(scene, tmp_path, 1024)
    assert np.abs(cycles - cycles.mean(axis=2, keepdims=True)).max() > 0.2, "no colours to tell"
    # What is beyond the gamut is taken from the nearest wavelengths.
    assert ours.mean(axis=(0, 1)) == pytest.approx(cycles.mean(axis=(0, 1)), rel=0.03)
    assert np.abs(ours.mean(axis=0) - np.maximum(cycles.mean(axis=0), 0.0)).mean() < 0.06


def test_lamps_and_white_surroundings_stay_white(scene, tmp_path):
    look_down(scene)
    prism(scene, 1.0, 20.0, roughness=0.5)
    floor, tree, output = add_material("Floor")
    white = node(tree, "ShaderNodeBsdfDiffuse", {"Color": (0.8, 0.8, 0.8, 1.0)})
    tree.links.new(white.outputs[0], output.inputs["Surface"])
    add_quad(scene, "Floor", size=20.0, material=floor).location.z = -1.0
    add_light(scene, "AREA", location=(0.0, 0.0, 4.0), size=6.0, energy=500.0)
    ours, cycles = both(scene, tmp_path, 1024)
    error = (ours - cycles).reshape(-1, 3).std(axis=0) / np.sqrt(ours[..., 0].size)
    mean = cycles.mean(axis=(0, 1))
    assert (np.abs(ours.mean(axis=(0, 1)) - mean) < 3.0 * error + 0.02 * mean).all()
