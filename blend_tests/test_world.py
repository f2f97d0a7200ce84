"""Worlds: colour, environment texture, and what is named."""

import bpy
import numpy as np
import pytest
from mathutils import Euler

from helpers import add_quad, exported


def world_tree(scene):
    """A world with Background and Output only."""
    world = bpy.data.worlds.new("World")
    scene.world = world
    if bpy.app.version < (5, 2, 0):
        world.use_nodes = True
    world.node_tree.nodes.clear()
    background = world.node_tree.nodes.new("ShaderNodeBackground")
    output = world.node_tree.nodes.new("ShaderNodeOutputWorld")
    world.node_tree.links.new(background.outputs[0], output.inputs["Surface"])
    add_quad(scene)
    return world.node_tree, background


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


def test_other_worlds_are_named(scene):
    tree, background = world_tree(scene)
    sky = tree.nodes.new("ShaderNodeTexSky")
    tree.links.new(sky.outputs[0], background.inputs["Color"])
    out = exported(scene)
    assert out["world"]["color"] == [0, 0, 0]
    assert any("world 'World': node 'Sky Texture' is not supported" in warning for warning in out["warnings"])


def test_camera_visibility(scene):
    world_tree(scene)
    scene.world.cycles_visibility.camera = False
    assert exported(scene)["world"]["visible_camera"] is False
