"""Procedural textures reach the native graph with every setting. Their values are compared in `test_node_values.py`."""

import bpy
import pytest

from helpers import add_material, add_quad, exported

pytestmark = pytest.mark.every_version

# Texture: settings of Blender's node and of ours.
SETTINGS = {
    "noise": (
        {"noise_dimensions": "4D", "noise_type": "HETERO_TERRAIN", "normalize": False},
        {"dimensions": "4D", "kind": "HETERO_TERRAIN", "normalize": False},
    ),
    "white_noise": ({"noise_dimensions": "2D"}, {"dimensions": "2D"}),
    "checker": ({}, {}),
    "gradient": ({"gradient_type": "QUADRATIC_SPHERE"}, {"kind": "QUADRATIC_SPHERE"}),
    "voronoi": (
        {"voronoi_dimensions": "4D", "feature": "SMOOTH_F1", "distance": "MINKOWSKI", "normalize": True},
        {"dimensions": "4D", "feature": "SMOOTH_F1", "metric": "MINKOWSKI", "normalize": True},
    ),
    "wave": (
        {"wave_type": "RINGS", "rings_direction": "SPHERICAL", "wave_profile": "TRI"},
        {"kind": "RINGS", "direction": "SPHERICAL", "profile": "TRI"},
    ),
    "magic": ({"turbulence_depth": 4}, {"depth": 4}),
    "brick": (
        {"offset": 0.25, "offset_frequency": 3, "squash": 0.75, "squash_frequency": 5},
        {"offset": 0.25, "offset_frequency": 3, "squash": 0.75, "squash_frequency": 5},
    ),
}


@pytest.fixture
def tree(scene):
    """The tree of a material on a plane, a node that shows a value, and a function that exports both."""
    material, tree, output = add_material("Paint")
    add_quad(scene, "Wall", material=material)
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])

    def export():
        summary = exported(scene)
        return summary["materials"][0]["nodes"], summary["warnings"]

    return tree, emission, export


def new(tree, name, settings):
    node = tree.nodes.new("ShaderNodeTex" + name.title().replace("_", ""))
    for key, value in settings.items():
        setattr(node, key, value)
    return node


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_and_sockets_are_exported(tree, name):
    tree, emission, export = tree
    settings, expected = SETTINGS[name]
    node = new(tree, name, settings)
    sockets = [socket for socket in node.inputs if socket.enabled and socket.type != "VECTOR"]
    for number, socket in enumerate(sockets, start=1):
        socket.default_value = [number / 16] * 3 + [1.0] if socket.type == "RGBA" else number / 16
    tree.links.new(node.outputs[0], emission.inputs["Color"])
    nodes, warnings = export()
    assert warnings == []
    found = nodes[0]
    assert (found["type"], found["texture"], found["vector"]) == (
        "procedural",
        name,
        [0.0] * 3 if name == "white_noise" else None,
    )
    assert {key: found[key] for key in expected} == expected
    for number, socket in enumerate(sockets, start=1):
        value = found[socket.identifier.lower().replace(" ", "_")]
        assert value == ([number / 16] * 3 if socket.type == "RGBA" else number / 16), socket.identifier


def test_outputs_share_a_node_and_positions_have_their_own(tree):
    tree, emission, export = tree
    voronoi = new(tree, "voronoi", {"voronoi_dimensions": "4D"})
    mix = tree.nodes.new("ShaderNodeMix")
    mix.data_type = "VECTOR"
    combine = tree.nodes.new("ShaderNodeCombineXYZ")
    tree.links.new(voronoi.outputs["Distance"], mix.inputs[0])
    tree.links.new(voronoi.outputs["Color"], mix.inputs[4])
    tree.links.new(voronoi.outputs["Position"], mix.inputs[5])
    tree.links.new(mix.outputs[1], emission.inputs["Color"])
    tree.links.new(voronoi.outputs["W"], combine.inputs[0])
    tree.links.new(combine.outputs[0], emission.inputs["Strength"])
    nodes, _ = export()
    assert [node.get("position") for node in nodes if node["type"] == "procedural"] == [False, True]
    mixed = next(node for node in nodes if node["type"] == "mix")
    assert [mixed[key]["output"] for key in ("factor", "a", "b")] == ["distance", "color", "vector"]
    assert mixed["factor"]["node"] == mixed["a"]["node"] != mixed["b"]["node"]
    combined = next(node for node in nodes if node["type"] == "combine_xyz")
    assert combined["x"] == {"node": mixed["b"]["node"], "output": "w"}


def test_points_of_voronoi_textures_are_those_of_the_blender_version(tree):
    tree, emission, export = tree
    tree.links.new(new(tree, "voronoi", {}).outputs["Color"], emission.inputs["Color"])
    assert export()[0][0]["hash"] == ("pcg" if bpy.app.version >= (5, 0, 0) else "jenkins")
