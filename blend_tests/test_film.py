"""Alpha of the film beside Cycles: transparent film and glass, holdouts of shaders, objects and collections."""

import bpy
import numpy as np
import pytest

from addon.export import trace_settings
from cards import node
from helpers import add, add_light, add_material, add_quad, add_world, both_lit, exported

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 512


def shaded(name, kind, **inputs):
    material, tree, output = add_material(name)
    tree.links.new(node(tree, kind, inputs).outputs[0], output.inputs["Surface"])
    return material


def card(scene, place, material):
    """A card a metre wide, one of a row that is seen from above."""
    found = add_quad(scene, material.name, size=1.0, material=material)
    found.location = (place + 0.5, 0.5, 0.0)
    return found


def both(scene, folder):
    """RGBA of a row of cards by Relume and Cycles, the mean of each [cards, 4]."""
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    cards = round(max(obj.location.x for obj in scene.objects if obj.type == "MESH") + 0.5)
    camera.data.type, camera.data.ortho_scale = "ORTHO", cards
    camera.location, camera.rotation_euler = (cards / 2, 0.5, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x, render.resolution_y = 8 * cards, 8
    render.image_settings.color_mode = "RGBA"
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    pictures = both_lit(scene, folder, SAMPLES, channels=4)
    return (image.reshape(8, cards, 8, 4)[2:-2, :, 2:-2].mean(axis=(0, 2)) for image in pictures)


def lit(scene):
    """A world and a lamp above."""
    add_world(scene, (0.4, 0.6, 0.8), 1.0)
    add_light(scene, "AREA", location=(1.0, 0.5, 6.0), size=4.0, energy=300.0)


@pytest.mark.parametrize("film", ["opaque", "transparent", "glass"])
def test_glass_and_what_is_behind_it_are_on_the_film_as_in_cycles(scene, film, tmp_path):
    lit(scene)
    scene.render.film_transparent = film != "opaque"
    scene.cycles.film_transparent_glass = film == "glass"
    scene.cycles.film_transparent_roughness = 0.3
    for place, roughness in enumerate((0.0, 0.3, 0.4)):
        glass = shaded(f"Glass {roughness}", "ShaderNodeBsdfGlass", Roughness=roughness, IOR=1.2)
        card(scene, place, glass)
    card(scene, 3, shaded("Clear", "ShaderNodeBsdfTransparent", Color=(0.5, 0.5, 0.5, 1.0)))
    card(scene, 4, shaded("Grey", "ShaderNodeBsdfDiffuse"))
    grey = card(scene, 5, shaded("Behind", "ShaderNodeBsdfDiffuse"))
    grey.location.z = -1.0
    card(scene, 5, shaded("Before", "ShaderNodeBsdfGlass", Roughness=0.0, IOR=1.2))
    ours, theirs = both(scene, tmp_path / "bake")
    assert np.abs(ours - theirs).max() < 0.02, (ours - theirs).round(3)
    assert (ours[:3, 3] < 0.99).tolist() == [film == "glass", film == "glass", False]


def test_holdouts_are_cut_out_of_the_film_as_in_cycles(scene, tmp_path):
    lit(scene)
    grey = shaded("Grey", "ShaderNodeBsdfDiffuse")
    card(scene, 0, grey).is_holdout = True
    card(scene, 1, shaded("Holdout", "ShaderNodeHoldout"))
    mixed, tree, output = add_material("Half")
    shaders = [node(tree, kind).outputs[0] for kind in ("ShaderNodeHoldout", "ShaderNodeEmission")]
    mix = node(tree, "ShaderNodeMixShader", {0: 0.25, 1: shaders[0], 2: shaders[1]})
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    card(scene, 2, mixed)
    half, tree, output = add_material("Half clear")
    shaders = [node(tree, kind).outputs[0] for kind in ("ShaderNodeEmission", "ShaderNodeBsdfTransparent")]
    mix = node(tree, "ShaderNodeMixShader", {0: 0.5, 1: shaders[0], 2: shaders[1]})
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    card(scene, 3, half).is_holdout = True
    behind = card(scene, 4, grey)
    behind.location.z = -1.0
    card(scene, 4, shaded("Cut", "ShaderNodeHoldout"))
    glowing = card(scene, 5, shaded("Glow", "ShaderNodeEmission", Strength=3.0))
    aside = bpy.data.collections.new("Aside")
    scene.collection.children.link(aside)
    aside.objects.link(glowing)
    scene.collection.objects.unlink(glowing)
    bpy.context.view_layer.layer_collection.children["Aside"].holdout = True
    # Its light is there although it is not seen itself.
    wall = card(scene, 6, grey)
    wall.rotation_euler.y = 0.6
    ours, theirs = both(scene, tmp_path / "bake")
    assert np.abs(ours - theirs).max() < 0.02, (ours - theirs).round(3)
    assert ours[[0, 1, 4, 5], 3] == pytest.approx(0.0, abs=1e-3)


def test_instances_are_held_out_by_what_instances_them_as_in_cycles(scene, tmp_path):
    lit(scene)
    for place, (inner, outer) in enumerate(((True, False), (False, True), (False, False))):
        source = card(scene, 0, shaded(f"Grey {place}", "ShaderNodeBsdfDiffuse"))
        source.location, source.is_holdout = (0.0, 0.0, 0.0), inner
        collection = bpy.data.collections.new(f"Source {place}")
        collection.objects.link(source)
        scene.collection.objects.unlink(source)
        empty = add(scene, f"Instance {place}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.location, empty.is_holdout = (place + 0.5, 0.5, 0.0), outer
    card(scene, 3, shaded("Last", "ShaderNodeBsdfDiffuse"))
    ours, theirs = both(scene, tmp_path / "bake")
    assert np.abs(ours - theirs).max() < 0.02, (ours, theirs)


def test_film_settings_are_a_part_of_the_bake(scene):
    def film(scene):
        paths = trace_settings(scene, lambda _: None)["paths"]
        return paths["film_transparent"], paths.get("film_glass")

    add_quad(scene)
    assert film(scene) == (False, None)
    scene.cycles.film_transparent_glass = True
    assert film(scene) == (False, None)
    scene.render.film_transparent = True
    assert film(scene) == (True, pytest.approx(0.1))
    scene.objects["Plane"].is_holdout = True
    assert exported(scene)["instances"][0]["is_holdout"]
