"""Nodes that turn, move and look up vectors give what they give in Cycles."""

import bpy
import numpy as np
import pytest
from test_image_textures import save

from cards import Cards, differences, node

pytestmark = pytest.mark.every_version


def varying(tree, scale=(0.7, 0.9, 0.5), location=(0.2, 0.1, 0.6)):
    """A vector that differs from place to place."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    inputs = {"Vector": coordinates.outputs["UV"], "Scale": scale, "Location": location}
    return node(tree, "ShaderNodeMapping", inputs).outputs[0]


def absolute(tree, vector):
    """A vector of which nothing is below 0, as cards can show it."""
    return node(tree, "ShaderNodeVectorMath", {0: vector}, operation="ABSOLUTE").outputs[0]


def compare(cards, tmp_path, tolerance=0.03):
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=tolerance) == {}
    assert warnings == []


@pytest.mark.parametrize("invert", [False, True])
def test_vectors_are_rotated(scene, tmp_path, invert):
    cards = Cards(scene)
    for kind in ("AXIS_ANGLE", "X_AXIS", "Y_AXIS", "Z_AXIS", "EULER_XYZ"):
        for is_linked in (False, True):
            tree, output = cards.add(f"{kind} {is_linked}")
            inputs = {"Vector": varying(tree), "Center": (0.1, 0.3, 0.2)}
            if kind == "EULER_XYZ":
                inputs["Rotation"] = varying(tree) if is_linked else (0.4, 0.8, 1.3)
            else:
                gradient = node(tree, "ShaderNodeSeparateXYZ", {0: varying(tree)})
                inputs["Angle"] = gradient.outputs["X"] if is_linked else 0.9
            if kind == "AXIS_ANGLE":
                inputs["Axis"] = varying(tree, location=(0.3, 0.2, 0.9)) if is_linked else (0.5, 1.0, 2.0)
            made = node(tree, "ShaderNodeVectorRotate", rotation_type=kind, invert=invert)
            for name, value in inputs.items():
                if isinstance(value, bpy.types.NodeSocket):
                    tree.links.new(value, made.inputs[name])
                else:
                    made.inputs[name].default_value = value
            cards.show(tree, output, absolute(tree, made.outputs[0]))
    compare(cards, tmp_path)


@pytest.mark.parametrize("kind", ["VECTOR", "POINT", "NORMAL"])
def test_vectors_are_taken_from_space_to_space(scene, tmp_path, kind):
    cards = Cards(scene)
    spaces = ("WORLD", "OBJECT", "CAMERA")
    for before in spaces:
        for after in spaces:
            name = f"{before} to {after}"
            tree, output = cards.add(name)
            card = scene.objects[name]
            card.data.transform(((1, 0, 0, 0), (0, 0.5, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)))
            card.scale = (1.0, 2.0, 0.7)
            made = node(
                tree,
                "ShaderNodeVectorTransform",
                {"Vector": varying(tree)},
                vector_type=kind,
                convert_from=before,
                convert_to=after,
            )
            cards.show(tree, output, absolute(tree, made.outputs[0]))
    compare(cards, tmp_path)


def test_places_are_known_from_the_camera(scene, tmp_path):
    cards = Cards(scene)
    for name in ("View Vector", "View Z Depth", "View Distance"):
        tree, output = cards.add(name)
        made = tree.nodes.new("ShaderNodeCameraData")
        cards.show(tree, output, absolute(tree, made.outputs[name]) if "Vector" in name else made.outputs[name])
    compare(cards, tmp_path)


def test_a_normal_node_gives_a_direction_and_a_cosine(scene, tmp_path):
    cards = Cards(scene)
    for name in ("Normal", "Dot"):
        tree, output = cards.add(name)
        made = node(tree, "ShaderNodeNormal", {"Normal": varying(tree)})
        made.outputs["Normal"].default_value = (0.3, 0.5, 0.8)
        cards.show(tree, output, made.outputs[name])
    compare(cards, tmp_path)


def test_vector_curves_are_looked_up(scene, tmp_path):
    cards = Cards(scene)
    for name, scale in (("inside", 1.0), ("beyond", 3.0)):
        tree, output = cards.add(name)
        made = node(tree, "ShaderNodeVectorCurve", {1: varying(tree, scale=(scale,) * 3)})
        made.inputs[0].default_value = 0.8
        for curve, height in zip(made.mapping.curves, (0.3, 0.6, 0.9), strict=True):
            curve.points.new(0.4, height)
        made.mapping.update()
        cards.show(tree, output, absolute(tree, made.outputs[0]))
    compare(cards, tmp_path)


def test_black_bodies_of_varying_temperature(scene, tmp_path):
    cards = Cards(scene)
    tree, output = cards.add("body")
    parts = node(
        tree, "ShaderNodeSeparateXYZ", {0: varying(tree, scale=(6000.0, 1.0, 1.0), location=(900.0, 0.0, 0.0))}
    )
    body = node(tree, "ShaderNodeBlackbody", {"Temperature": parts.outputs["X"]})
    cards.show(tree, output, body.outputs[0])
    compare(cards, tmp_path)


@pytest.mark.parametrize("projection", ["EQUIRECTANGULAR", "MIRROR_BALL"])
def test_environment_textures_serve_in_materials(scene, tmp_path, projection):
    pixels = np.random.default_rng(4).random((8, 8, 4)) * [1, 1, 1, 0] + [0, 0, 0, 1]
    save(tmp_path / "sky.png", pixels)
    image = bpy.data.images.load(str(tmp_path / "sky.png"))
    cards = Cards(scene)
    for name in ("linked", "alone"):
        tree, output = cards.add(name)
        texture = node(tree, "ShaderNodeTexEnvironment", image=image, projection=projection)
        if name == "linked":
            tree.links.new(varying(tree, location=(-0.3, -0.5, -0.2)), texture.inputs["Vector"])
        cards.show(tree, output, texture.outputs[0])
    compare(cards, tmp_path, tolerance=0.04)
