"""Radial Tiling gives what it gives in Cycles."""

import bpy
import pytest

from cards import Cards, differing_pixels, node

pytestmark = [
    pytest.mark.every_version,
    pytest.mark.skipif(not hasattr(bpy.types, "ShaderNodeRadialTiling"), reason="Blender has it from 5.1 on"),
]


def shown(tree, number):
    """A number as a card can show it."""
    return node(tree, "ShaderNodeMath", {0: number, 1: 0.1, 2: 0.5}, operation="MULTIPLY_ADD").outputs[0]


@pytest.mark.parametrize("normalize", [False, True])
@pytest.mark.parametrize("sides", [2.0, 2.4, 3.0, 4.7, 6.0])
def test_segments_are_those_of_cycles(scene, tmp_path, sides, normalize):
    """Each output from the middle of a card, for corners of three kinds, and of sides that vary."""
    cards = Cards(scene, columns=5)
    for roundness in (0.0, 1.0) if sides == 2.0 else (0.0, 0.35, 1.0):  # Two sides have no corners to round.
        for output in ("X", "Y", "Segment ID", "Segment Width", "Segment Rotation"):
            tree, card = cards.add(f"{output} {roundness}")
            coordinates = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
            inputs = {"Vector": coordinates, "Sides": sides, "Roundness": roundness}
            tiling = node(tree, "ShaderNodeRadialTiling", inputs, normalize=normalize)
            if output in {"X", "Y"}:
                value = node(tree, "ShaderNodeSeparateXYZ", {0: tiling.outputs[0]}).outputs[output]
            else:
                value = tiling.outputs[output]
            cards.show(tree, card, shown(tree, value))
    found, warnings = differing_pixels(cards, tmp_path, tolerance=0.02)
    assert (found, warnings) == ({}, [])


def test_sides_and_vectors_may_be_anything(scene, tmp_path):
    cards = Cards(scene)
    for name, sides in {"varying": None, "too few": 1.0, "many": 23.5}.items():
        tree, card = cards.add(name)
        coordinates = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        u = node(tree, "ShaderNodeSeparateXYZ", {0: coordinates}).outputs[0]
        varying = node(tree, "ShaderNodeMath", {0: u, 1: 4.0, 2: 2.0}, operation="MULTIPLY_ADD").outputs[0]
        inputs = {"Vector": coordinates, "Sides": varying if sides is None else sides, "Roundness": 0.5}
        tiling = node(tree, "ShaderNodeRadialTiling", inputs)
        cards.show(tree, card, shown(tree, tiling.outputs["Segment Rotation"]))
    tree, card = cards.add("nowhere")
    cards.show(tree, card, shown(tree, tree.nodes.new("ShaderNodeRadialTiling").outputs["Segment Width"]))
    found, warnings = differing_pixels(cards, tmp_path, tolerance=0.02)
    assert (found, warnings) == ({}, [])
