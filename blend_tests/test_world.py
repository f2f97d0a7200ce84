"""Worlds: colour, environment texture, what of nodes can be folded into them, and what is named."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.engine.staleness.world_fingerprints import world as fingerprint
from helpers import add, add_quad, add_world, exported

pytestmark = pytest.mark.every_version


def world_tree(scene):
    """A world with Background and Output only."""
    background = add_world(scene)
    add_quad(scene)
    return scene.world.node_tree, background


def environment(tree, background):
    """An environment texture that feeds the colour; returns the node."""
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = bpy.data.images.new("Sky", 8, 4, float_buffer=True)
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    return texture


def matrix_of(world):
    """Texture direction from world direction."""
    return np.array(world["texture_from_world"]).reshape(3, 3).T


def test_color_times_strength(scene):
    _, background = world_tree(scene)
    background.inputs["Color"].default_value = (0.1, 0.2, 0.4, 1.0)
    background.inputs["Strength"].default_value = 3.0
    assert exported(scene)["world"]["color"] == pytest.approx([0.3, 0.6, 1.2])


def test_no_world_is_black(scene):
    scene.world = None
    add_quad(scene)
    assert exported(scene)["world"]["color"] == [0, 0, 0]


@pytest.mark.parametrize("kind", ["POINT", "TEXTURE", "VECTOR", "NORMAL"])
def test_environment_texture_keeps_its_mapping(scene, kind):
    tree, background = world_tree(scene)
    texture, mapping = tree.nodes.new("ShaderNodeTexEnvironment"), tree.nodes.new("ShaderNodeMapping")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    texture.image = bpy.data.images.new("Sky", 8, 4, float_buffer=True)
    mapping.vector_type = kind
    rotation, scale = (0.1, 0.2, 0.7), (1.0, 2.0, 0.5)
    mapping.inputs["Rotation"].default_value = rotation
    mapping.inputs["Scale"].default_value = scale
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    background.inputs["Strength"].default_value = 2.0
    world = exported(scene)["world"]
    assert world["texture"] == 0 and world["color"] == [2, 2, 2]
    matrix = np.array(world["texture_from_world"]).reshape(3, 3).T
    turn, scale = np.array(Euler(rotation).to_matrix()), np.diag(scale)
    expected = {
        "POINT": turn @ scale,
        "VECTOR": turn @ scale,
        "TEXTURE": np.linalg.inv(scale) @ turn.T,
        "NORMAL": turn @ np.linalg.inv(scale),
    }[kind]
    assert matrix == pytest.approx(expected, abs=1e-5)


def test_camera_visibility(scene):
    world_tree(scene)
    scene.world.cycles_visibility.camera = False
    assert exported(scene)["world"]["visible_camera"] is False


def test_a_rotation_that_nodes_give_is_followed(scene):
    tree, background = world_tree(scene)
    texture, mapping = environment(tree, background), tree.nodes.new("ShaderNodeMapping")
    combine, value = tree.nodes.new("ShaderNodeCombineXYZ"), tree.nodes.new("ShaderNodeValue")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    value.outputs[0].driver_add("default_value").driver.expression = "0.5 + 0.2"
    tree.links.new(value.outputs[0], combine.inputs["Z"])
    tree.links.new(combine.outputs[0], mapping.inputs["Rotation"])
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    assert matrix_of(exported(scene)["world"]) == pytest.approx(np.array(Euler((0, 0, 0.7)).to_matrix()), abs=1e-5)


def test_an_object_turns_the_environment_texture(scene):
    tree, background = world_tree(scene)
    texture, coordinates = environment(tree, background), tree.nodes.new("ShaderNodeTexCoord")
    coordinates.object = empty = add(scene, "Turn", None)
    empty.rotation_euler = (0.1, 0.2, 0.7)
    tree.links.new(coordinates.outputs["Object"], texture.inputs["Vector"])
    turn = np.array(empty.rotation_euler.to_matrix())
    assert matrix_of(exported(scene)["world"]) == pytest.approx(turn.T, abs=1e-5)


@pytest.mark.parametrize(
    ("kind", "output"), [("TexCoord", "Normal"), ("TexCoord", "Reflection"), ("NewGeometry", "Incoming")]
)
def test_what_looks_back_gives_the_opposite_direction(scene, kind, output):
    tree, background = world_tree(scene)
    texture, source = environment(tree, background), tree.nodes.new(f"ShaderNode{kind}")
    tree.links.new(source.outputs[output], texture.inputs["Vector"])
    assert matrix_of(exported(scene)["world"]) == pytest.approx(-np.identity(3))


@pytest.mark.parametrize("kind", ["shader", "color", "strength"])
def test_another_background_for_the_camera_is_a_part_of_the_world(scene, kind):
    tree, background = world_tree(scene)
    background.inputs["Color"].default_value = (1.0, 0.5, 0.25, 1.0)
    background.inputs["Strength"].default_value = 2.0
    path = tree.nodes.new("ShaderNodeLightPath")
    camera = path.outputs["Is Camera Ray"]
    if kind == "shader":
        mix, other = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeBackground")
        other.inputs["Color"].default_value = (0.1, 0.2, 0.3, 1.0)
        for source, target in zip((camera, background.outputs[0], other.outputs[0]), mix.inputs[:3], strict=True):
            tree.links.new(source, target)
        tree.links.new(mix.outputs[0], tree.get_output_node("CYCLES").inputs["Surface"])
    else:
        mix = tree.nodes.new("ShaderNodeMix")
        mix.data_type = "RGBA" if kind == "color" else "FLOAT"
        sockets = {socket.identifier: socket for socket in mix.inputs}
        tree.links.new(camera, sockets["Factor_Float"])
        if kind == "color":
            sockets["A_Color"].default_value = background.inputs["Color"].default_value
            sockets["B_Color"].default_value = (0.1, 0.2, 0.3, 1.0)
            tree.links.new(next(socket for socket in mix.outputs if socket.type == "RGBA"), background.inputs["Color"])
        else:
            sockets["A_Float"].default_value, sockets["B_Float"].default_value = 2.0, 7.0
            tree.links.new(mix.outputs[0], background.inputs["Strength"])
    found = exported(scene)
    assert found["world"]["color"] == pytest.approx([2.0, 1.0, 0.5]) and found["world"]["texture"] is None
    (part,) = found["world"]["parts"]
    seen = {"shader": [0.1, 0.2, 0.3], "color": [0.2, 0.4, 0.6], "strength": [7.0, 3.5, 1.75]}[kind]
    assert part["color"] == pytest.approx(seen) and part["rays"] == [True, False, False, False, False]
    assert found["warnings"] == []
    before = fingerprint(scene)
    path.mute, background.inputs["Color"].default_value = True, (1.0, 1.0, 1.0, 1.0)
    assert fingerprint(scene)["shape"] != before["shape"]


def test_rays_that_do_not_see_the_world_see_a_black_part(scene):
    world_tree(scene)
    visibility = scene.world.cycles_visibility
    visibility.glossy = visibility.scatter = False
    found = exported(scene)
    assert found["warnings"] == []
    (part,) = found["world"]["parts"]
    assert (part["color"], part["rays"]) == ([0.0] * 3, [False, False, True, False, True])
    visibility.diffuse = visibility.transmission = False
    world = exported(scene)["world"]
    assert any(world["color"]) and world["parts"][0]["rays"] == [False, True, True, True, True]
    visibility.camera = False
    world = exported(scene)["world"]
    assert (world["color"], world["parts"]) == ([0.0] * 3, [])


def test_depth_of_rays_in_a_world_is_named(scene):
    tree, background = world_tree(scene)
    path = tree.nodes.new("ShaderNodeLightPath")
    tree.links.new(path.outputs["Ray Depth"], background.inputs["Strength"])
    (warning,) = exported(scene)["warnings"]
    assert "are those after one bounce" in warning


def test_the_view_layer_chooses_the_world(scene):
    _, background = world_tree(scene)
    background.inputs["Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    background.inputs["Strength"].default_value = 1.0
    override, kept = scene.world, bpy.data.worlds.new("Kept")
    scene.world = kept
    scene.view_layers[0].world_override = override
    assert exported(scene)["world"]["color"] == [1, 0, 0]
    scene.view_layers[0].use_sky = False
    assert exported(scene)["world"]["color"] == [0, 0, 0]


def test_settings_that_paths_cannot_represent_are_named(scene):
    world_tree(scene)
    assert exported(scene)["warnings"] == []
    world = scene.world
    world.cycles.max_bounces = 3
    words = ["limit of its bounces"]
    if hasattr(world.cycles, "use_shadows"):
        world.cycles.use_shadows = False
        words.append("light without shadow")
    warnings = exported(scene)["warnings"]
    assert len(warnings) == len(words)
    assert all(any(word in warning and "world 'Sky'" in warning for warning in warnings) for word in words)
