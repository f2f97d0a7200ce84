"""Floor, wall, camera and materials of the feature scenes. Needs `bpy`."""

import math

import bpy

import stage as hunt


def set_up(width, height):
    """A new file with a floor, a wall behind and a camera that looks at the space above the origin."""
    scene = hunt.empty_scene(width, height)
    floor, wall = (
        hunt.add(scene, name, hunt.square(name, 6.0, hunt.plain_material(name, Color=color)))
        for name, color in (("Floor", (0.6, 0.6, 0.55, 1.0)), ("Wall", (0.7, 0.45, 0.35, 1.0)))
    )
    wall.location, wall.rotation_euler = (0.0, 2.0, 1.0), (math.pi / 2, 0.0, 0.0)
    floor.location.z = -1.0
    hunt.add_camera(scene, (0.0, -5.0, 1.4), (1.35, 0.0, 0.0))
    scene.cycles.max_bounces = 8
    scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = scene.cycles.transmission_bounces = 6
    return scene


def volume(name, kind="ShaderNodeVolumeScatter", **inputs):
    """A material of one volume shader and no surface; returns it, its tree and the shader."""
    material, tree, output = hunt.new_material(name)
    node = tree.nodes.new(kind)
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Volume"])
    return material, tree, node


def add_ball(scene, name, radius, material, location=(0.0, 0.0, 0.0)):
    """A smooth ball."""
    ball = hunt.add(scene, name, hunt.ball(name, radius, material, rings=24))
    ball.location = location
    return ball


def add_box(scene, name, size, material, location=(0.0, 0.0, 0.0)):
    """A cube."""
    box = hunt.add(scene, name, hunt.box(name, size, material))
    box.location = location
    return box


def keep_lamps_out_of_forward_hits(scene):
    """Marks a scene whose lamps have *Multiple Importance* off: with it on, Cycles loses light that is scattered in a
    medium behind or inside of a lamp."""
    scene["parity_single_importance"] = True


def step_finely(scene):
    """Makes Cycles before 5.0 march through volumes in steps too short to bias the picture."""
    if bpy.app.version < (5, 0, 0):
        scene.cycles.volume_step_rate = 0.05
        scene.cycles.volume_max_steps = 65536
