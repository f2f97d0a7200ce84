"""Lamps and worlds whose nodes come to a constant shine as in Cycles; others are named with the node that varies."""

import bpy
import pytest

from cards import Cards, differences, node
from helpers import add_light, add_quad, add_world, background, exported

pytestmark = pytest.mark.every_version

RED, GREEN = (0.8, 0.3, 0.1, 1.0), (0.1, 0.6, 0.2, 1.0)


def emission(tree, color=RED, strength=0.7):
    return node(tree, "ShaderNodeEmission", {"Color": color, "Strength": strength}).outputs[0]


def mixed(tree, factor, first, second):
    return node(tree, "ShaderNodeMixShader", {0: factor, 1: first, 2: second}).outputs[0]


def maths(tree, operation="MULTIPLY", first=0.6, second=1.5):
    return node(tree, "ShaderNodeMath", {0: first, 1: second}, operation=operation).outputs[0]


def of(kind, inputs, output=0, **settings):
    """A lamp whose colour a node gives."""
    return lambda tree: emission(tree, node(tree, kind, inputs, **settings).outputs[output])


def falloff(tree, strength=1.4, output="Quadratic", smooth=0.0):
    return node(tree, "ShaderNodeLightFalloff", {"Strength": strength, "Smooth": smooth}).outputs[output]


def light_path(tree, output):
    return node(tree, "ShaderNodeLightPath").outputs[output]


def curve(tree):
    made = node(tree, "ShaderNodeRGBCurve", {"Color": RED})
    made.mapping.curves[0].points.new(0.5, 0.9)
    return emission(tree, made.outputs[0])


def texture_left_out(tree):
    checker = node(tree, "ShaderNodeTexChecker").outputs[0]
    mix = node(tree, "ShaderNodeMix", {"Factor_Float": 0.0, "A_Color": RED, "B_Color": checker}, data_type="RGBA")
    return emission(tree, mix.outputs[2])


def muted(tree):
    made = node(tree, "ShaderNodeBlackbody")
    made.mute = True
    return emission(tree, made.outputs[0])


CONSTANT = {
    "color": lambda t: node(t, "ShaderNodeGamma", {"Color": RED}).outputs[0],
    "number": lambda t: node(t, "ShaderNodeMath", {0: 0.4, 1: 0.2}).outputs[0],
    "maths": lambda t: emission(t, RED, maths(t)),
    "color as strength": lambda t: emission(t, RED, node(t, "ShaderNodeRGB").outputs[0]),
    "ramp": of("ShaderNodeValToRGB", {0: 0.3}),
    "curve": curve,
    "blackbody": of("ShaderNodeBlackbody", {0: 3200.0}),
    "blackbody of maths": lambda t: of("ShaderNodeBlackbody", {0: maths(t, "ADD", 2500.0, 700.0)})(t),
    "hue": of("ShaderNodeHueSaturation", {"Color": RED, "Hue": 0.7}),
    "gamma": of("ShaderNodeGamma", {"Color": RED, "Gamma": 2.0}),
    "mix": of("ShaderNodeMix", {"A_Color": RED, "B_Color": GREEN}, 2, data_type="RGBA", blend_type="SCREEN"),
    "combine": of("ShaderNodeCombineColor", {0: 0.3, 1: 0.6, 2: 0.5}, mode="HSV"),
    "texture left out": texture_left_out,
    "mix shader": lambda t: mixed(t, 0.3, emission(t), emission(t, GREEN)),
    "add shader": lambda t: node(t, "ShaderNodeAddShader", {0: emission(t), 1: emission(t, GREEN)}).outputs[0],
    "transparent": lambda t: mixed(t, 0.3, emission(t), node(t, "ShaderNodeBsdfTransparent").outputs[0]),
    "diffuse": lambda t: mixed(t, 0.3, emission(t), node(t, "ShaderNodeBsdfDiffuse").outputs[0]),
    "background": lambda t: node(t, "ShaderNodeBackground", {"Color": RED}).outputs[0],
    "falloff": lambda t: emission(t, RED, falloff(t)),
    "camera ray": lambda t: mixed(t, light_path(t, "Is Camera Ray"), emission(t), emission(t, GREEN)),
    "shadow ray": lambda t: emission(t, RED, maths(t, "SUBTRACT", 1.0, light_path(t, "Is Shadow Ray"))),
    "muted": muted,
}

VARYING = {
    "Checker Texture": lambda t: emission(t, node(t, "ShaderNodeTexChecker").outputs[0]),
    "Light Falloff": lambda t: emission(t, RED, maths(t, "ADD", falloff(t, output="Linear"), 1.0)),
    "Light Path": lambda t: emission(t, RED, light_path(t, "Ray Length")),
    "Layer Weight": lambda t: mixed(t, node(t, "ShaderNodeLayerWeight").outputs[1], emission(t), emission(t)),
}


def output_of(lamp):
    return next(node for node in lamp.node_tree.nodes if node.bl_idname == "ShaderNodeOutputLight").inputs["Surface"]


def test_lamps_that_come_to_a_constant_shine_as_in_cycles(scene, tmp_path):
    scene.cycles.max_bounces = 0
    cards = Cards(scene, columns=5)
    for name, build in CONSTANT.items():
        lamp = cards.add_lit(name)
        lamp.node_tree.links.new(build(lamp.node_tree), output_of(lamp))
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.04) == {}
    assert warnings == []


@pytest.mark.parametrize("name", VARYING)
def test_lamps_that_vary_are_left_out_and_the_node_is_named(scene, name):
    add_quad(scene)
    lamp = add_light(scene, "POINT").data
    if bpy.app.version < (5, 2, 0):
        lamp.use_nodes = True
    lamp.node_tree.links.new(VARYING[name](lamp.node_tree), output_of(lamp))
    out = exported(scene)
    assert out["lights"] == []
    assert [warning for warning in out["warnings"] if "light 'Lamp'" in warning and f"({name})" in warning]


@pytest.mark.parametrize("output", ["Quadratic", "Linear", "Constant"])
def test_falloff_makes_no_difference_to_a_sun(scene, output):
    """But where Cycles multiplies by its distance, which is none: it is black."""
    add_quad(scene)
    sun = add_light(scene, "SUN").data
    if bpy.app.version < (5, 2, 0):
        sun.use_nodes = True
    sun.node_tree.links.new(emission(sun.node_tree, RED, falloff(sun.node_tree, 1.0, output)), output_of(sun))
    out = exported(scene)
    if output != "Quadratic" and bpy.app.version < (4, 5, 0):
        assert out["lights"] == [] and "(Light Falloff)" in out["warnings"][0]
    else:
        (light,) = out["lights"]
        assert [channel / light["radiance"][0] for channel in light["radiance"]] == pytest.approx([1.0, 0.375, 0.125])


@pytest.mark.parametrize("name", ["color", "maths", "hue", "add shader", "background"])
def test_worlds_that_come_to_a_constant_are_a_color(scene, tmp_path, name):
    """Seen by a card that mirrors it."""
    add_world(scene)
    tree = scene.world.node_tree
    tree.links.new(CONSTANT[name](tree), background(scene).outputs[0].links[0].to_socket)
    cards = Cards(scene)
    tree, output = cards.add("mirror")
    tree.links.new(node(tree, "ShaderNodeBsdfAnisotropic", {"Roughness": 0.0}).outputs[0], output.inputs[0])
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    assert warnings == []
