"""Random worlds, as a mirror and a matt ball show them."""

import math

import trees

import stage

MIXES = ("ShaderNodeMixShader", "ShaderNodeAddShader")


def prepare(rng, width, height):
    """An empty scene."""
    scene = stage.empty_scene(width, height)
    scene.cycles.max_bounces = 2
    return scene


def add(scene, rng, palette, name, x, y):
    """A world, and two balls in its middle."""
    tilt = 0.05  # At a pole Cycles mixes both, and so does the texture that a world becomes.
    scene.camera.location.y -= scene.camera.location.z * math.tan(tilt)
    scene.camera.rotation_euler.x = tilt
    scene.world = new_world(name)
    tree = scene.world.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputWorld")
    tree.links.new(backgrounds(rng, tree, palette, 1), output.inputs["Surface"])
    mirror = stage.plain_material("Mirror", "ShaderNodeBsdfAnisotropic", Color=(1, 1, 1, 1), Roughness=0.0)
    for part, material, side in (("Mirror", mirror, -0.25), ("Matt", stage.plain_material("Matt"), 0.25)):
        stage.add(scene, part, stage.ball(part, 0.24, material)).location = (x + side, y, 0)


def new_world(name):
    """A new world with a tree."""
    world = stage.bpy.data.worlds.new(name)
    stage.use_nodes(world)
    return world


def backgrounds(rng, tree, palette, depth):
    """The output of Background nodes that are mixed at random, each fed by a random graph."""
    if depth and rng.random() < 0.25:
        mix = tree.nodes.new(rng.choice(MIXES))
        trees.set_inputs(rng, mix)
        for socket in mix.inputs:
            if socket.type == "SHADER":
                tree.links.new(backgrounds(rng, tree, palette, depth - 1), socket)
        return mix.outputs[0]
    node = tree.nodes.new("ShaderNodeBackground" if rng.random() < 0.9 else "ShaderNodeEmission")
    node.inputs["Color"].default_value = [rng.random() for _ in range(3)] + [1.0]
    for name in ("Color", "Strength"):
        if rng.random() < (0.9 if name == "Color" else 0.15):
            nodes = trees.grow(rng, tree, palette["values"], rng.randint(1, 4))
            trees.link_output(rng, tree, nodes, node.inputs[name])
    return node.outputs[0]
