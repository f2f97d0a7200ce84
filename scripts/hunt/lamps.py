"""A random lamp in a small room, of any size, with any of its settings."""

import math

import bpy
import trees

import stage

TYPES = ("POINT", "SPOT", "SPOT", "AREA", "AREA", "AREA", "SUN")
FOLDING = (
    "Value",
    "RGB",
    "Math",
    "VectorMath",
    "MixRGB",
    "Mix",
    "Clamp",
    "MapRange",
    "ValToRGB",
    "RGBCurve",
    "FloatCurve",
)
FOLDING += (
    "HueSaturation",
    "BrightContrast",
    "Gamma",
    "Invert",
    "RGBToBW",
    "CombineColor",
    "SeparateColor",
    "CombineXYZ",
)
FOLDING += ("Blackbody", "Wavelength", "LightPath", "LightFalloff")
"""Nodes that give a constant in a lamp, where constants feed them."""


def prepare(rng):
    """Floor, wall, a rough metal ball and a camera."""
    scene = stage.empty_scene(32, 24)
    stage.add_camera(scene, (0.0, -6.0, 3.0), (1.15, 0.0, 0.0))
    stage.add(scene, "Floor", stage.square("Floor", 10.0, stage.plain_material("Floor", Color=(0.7, 0.7, 0.6, 1))))
    wall = stage.add(scene, "Wall", stage.square("Wall", 10.0, stage.plain_material("Wall", Color=(0.7, 0.3, 0.2, 1))))
    wall.location, wall.rotation_euler = (0, 3, 0), (math.pi / 2, 0, 0)
    metal = stage.plain_material("Ball", "ShaderNodeBsdfAnisotropic", Color=(0.8, 0.8, 0.8, 1), Roughness=0.4)
    ball = stage.add(scene, "Ball", stage.ball("Ball", 0.6, metal))
    ball.location = (0.4, 0.2, 0.6)
    scene.cycles.max_bounces = rng.choice([0, 1, 3])
    return scene


def choices(scene, rng, palette):
    """The lamp's settings, each of which can be left out."""
    obj = new_lamp(scene, rng, "Lamp")
    yield from settings_of(rng, obj)
    if rng.random() < 0.4:
        yield "a node tree", lambda: fold(rng, obj.data)


def new_lamp(scene, rng, name):
    """A lamp over the floor that shines downwards, more or less."""
    data = bpy.data.lights.new(name, rng.choice(TYPES))
    data.energy = 3.0 if data.type == "SUN" else 200.0
    obj = stage.add(scene, name, data)
    obj.location = (rng.uniform(-2, 2), rng.uniform(-2.5, 1.5), rng.uniform(1.3, 3))
    obj.rotation_euler = [rng.uniform(-0.8, 0.8), rng.uniform(-0.8, 0.8), rng.uniform(-3, 3)]
    return obj


def settings_of(rng, obj):
    """Pairs of a setting in words and what sets it."""
    data = obj.data
    for name, value in values(rng, data).items():
        if hasattr(data, name):
            yield f"lamp.{name} = {value!r}", lambda name=name, value=value: setattr(data, name, value)
    for name in ("camera", "diffuse", "glossy", "transmission", "volume_scatter", "shadow"):
        if rng.random() < 0.12:
            yield f"visible_{name} = False", lambda name=name: setattr(obj, f"visible_{name}", False)


def values(rng, data):
    """Random settings of a lamp; lengths from a millimetre to ten metres."""
    size, size_y = (10 ** rng.uniform(-3, 1) if rng.random() < 0.5 else rng.uniform(0.1, 2) for _ in range(2))
    found = {
        "color": [rng.random() for _ in range(3)],
        "exposure": rng.choice([0.0, 1.0, -0.7]),
        "use_temperature": rng.random() < 0.3,
        "temperature": rng.choice([1500, 3200, 6500, 12000]),
        "normalize": rng.random() < 0.7,
        "diffuse_factor": rng.choice([1.0, 1.0, 0.4]),
        "specular_factor": rng.choice([1.0, 1.0, 0.4]),
        "shadow_soft_size": rng.choice([size, size, 0.0]),
        "use_soft_falloff": rng.random() < 0.5,
        "spot_size": rng.choice([rng.uniform(0.02, math.pi), math.pi]),
        "spot_blend": rng.choice([0.0, 0.15, rng.random(), 1.0]),
        "use_square": rng.random() < 0.2,
        "shape": rng.choice(["SQUARE", "RECTANGLE", "DISK", "ELLIPSE"]),
        "size": size,
        "size_y": size_y,
        "spread": rng.choice([math.pi, math.pi, rng.uniform(0.02, math.pi), 0.0]),
        "angle": rng.choice([0.0, 0.01, rng.uniform(0, math.pi), math.pi]),
        "use_shadow": rng.random() < 0.9,
    }
    return {name: value for name, value in found.items() if rng.random() < 0.6}


def fold(rng, data):
    """A node tree of the lamp that gives one colour, or nearly so."""
    tree = stage.use_nodes(data)
    tree.nodes.clear()
    output, emission = tree.nodes.new("ShaderNodeOutputLight"), tree.nodes.new("ShaderNodeEmission")
    trees.set_inputs(rng, emission)
    kinds = [kind for kind in (f"ShaderNode{name}" for name in FOLDING) if hasattr(bpy.types, kind)]
    nodes = trees.grow(rng, tree, trees.Palette(kinds), rng.randint(1, 4))
    trees.link_output(rng, tree, nodes, emission.inputs[rng.choice(["Color", "Strength"])])
    tree.links.new(emission.outputs[0], output.inputs[0])
