"""Worlds that rays of some kinds see differently, beside Cycles: what mirrors, glass and dull cards show of them."""

import bpy
import numpy as np
import pytest

from cards import Cards, differences, node
from helpers import add_world

pytestmark = pytest.mark.oldest_and_newest

CARDS = {
    "dull": ("ShaderNodeBsdfDiffuse", {}),
    "mirror": ("ShaderNodeBsdfGlossy", {"Roughness": 0.0}),
    "blurred": ("ShaderNodeBsdfGlossy", {"Roughness": 0.4}),
    "glass": ("ShaderNodeBsdfRefraction", {"Roughness": 0.0}),
    "clear": ("ShaderNodeBsdfTransparent", {"Color": (0.5, 0.9, 0.7, 1.0)}),
}


@pytest.fixture
def cards(scene):
    """A card of each kind that reflects, refracts or lets through."""
    made = Cards(scene, columns=len(CARDS))
    for name, (kind, inputs) in CARDS.items():
        tree, output = made.add(name)
        made.show(tree, output, node(tree, kind, inputs).outputs[0])
    scene.cycles.blur_glossy = 0.0
    scene.cycles.sample_clamp_direct = scene.cycles.sample_clamp_indirect = 0.0
    add_world(scene, (0.4, 0.6, 0.9), 1.0)
    return made


def mixed(scene, socket):
    """Another background where an output of Light Path is 1; returns it."""
    tree = scene.world.node_tree
    output = tree.get_output_node("CYCLES")
    usual = output.inputs["Surface"].links[0].from_socket
    other = node(tree, "ShaderNodeBackground", {"Color": (0.9, 0.3, 0.1, 1.0), "Strength": 2.0})
    path = node(tree, "ShaderNodeLightPath").outputs[socket]
    mix = node(tree, "ShaderNodeMixShader", {0: path, 1: usual, 2: other.outputs[0]})
    tree.links.new(mix.outputs[0], output.inputs["Surface"])
    return other


def check(cards, tmp_path):
    means, warnings = cards.means(tmp_path, samples=256)
    assert warnings == []
    assert differences(means, tolerance=0.03) == {}


@pytest.mark.parametrize("kind", ["Camera", "Glossy", "Diffuse", "Transmission", "Reflection"])
def test_each_kind_of_ray_sees_its_background(cards, scene, kind, tmp_path):
    mixed(scene, f"Is {kind} Ray")
    check(cards, tmp_path)


@pytest.mark.parametrize("rays", ["camera", "diffuse", "glossy", "transmission"])
def test_a_world_is_black_to_rays_that_do_not_see_it(cards, scene, rays, tmp_path):
    setattr(scene.world.cycles_visibility, rays, False)
    check(cards, tmp_path)


def test_a_picture_lights_and_another_is_seen(cards, scene, tmp_path):
    tree = scene.world.node_tree
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.new("Sky", 8, 4, float_buffer=True)
    texture.image.colorspace_settings.name = "Non-Color"
    pixels = np.random.default_rng(3).random((4, 8, 4), np.float32) * 2.0
    texture.image.pixels.foreach_set(pixels.reshape(-1))
    background = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeBackground")
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    mixed(scene, "Is Camera Ray")
    check(cards, tmp_path)
