"""Feature scenes of lamps whose nodes make them differ by direction or place. Need `bpy`."""

import math

import bpy

from . import stage

ANGLES = (0, 15, 30, 45, 60, 75, 90, 120, 180)
PLANES = (0, 45, 90, 135, 180, 225, 270, 315, 360)


def ies_lights(scene):
    """Points and a spot with photometric files: one plane, eight planes, and a strength that a texture tints."""
    _ball(scene)
    for place, (kind, planes) in zip(
        (-1.2, 0.0, 1.2), (("POINT", (0,)), ("POINT", PLANES), ("SPOT", PLANES)), strict=True
    ):
        tree, emission = _lamp(scene, kind, (place, 0.3, 0.9), (0.3 * place, 0.2, 0.5))
        ies = tree.nodes.new("ShaderNodeTexIES")
        ies.ies = bpy.data.texts.new("Photometry")
        ies.ies.write(photometry(planes))
        tree.links.new(ies.outputs[0], emission.inputs["Strength"])


def gobo_spots(scene):
    """Spots with an image in their cone's square, and with a checker about their axis by the normal."""
    _ball(scene)
    tree, emission = _lamp(scene, "SPOT", (-1.0, -0.8, 1.2), (0.5, -0.4, 0.6))
    image = tree.nodes.new("ShaderNodeTexImage")
    image.image, image.extension = _picture(), "CLIP"
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], emission.inputs["Color"])
    tree, emission = _lamp(scene, "SPOT", (1.2, -0.8, 1.2), (0.5, 0.4, 0.0))
    checker, coordinates = tree.nodes.new("ShaderNodeTexChecker"), tree.nodes.new("ShaderNodeTexCoord")
    checker.inputs["Scale"].default_value = 7.0
    checker.inputs["Color1"].default_value = (1.0, 0.5, 0.2, 1.0)
    checker.inputs["Color2"].default_value = (0.1, 0.2, 0.6, 1.0)
    tree.links.new(coordinates.outputs["Normal"], checker.inputs["Vector"])
    tree.links.new(checker.outputs["Color"], emission.inputs["Color"])


def softboxes(scene):
    """A softbox with a window's bars, a disk bright in its middle, an area with a file, and a wide coloured sun."""
    _ball(scene)
    tree, emission = _lamp(scene, "AREA", (-1.3, -0.4, 0.3), (0.0, -1.1, 0.0))
    image, coordinates = tree.nodes.new("ShaderNodeTexImage"), tree.nodes.new("ShaderNodeTexCoord")
    image.image = _picture()
    tree.links.new(coordinates.outputs["UV"], image.inputs["Vector"])
    tree.links.new(image.outputs["Color"], emission.inputs["Color"])
    tree, emission = _lamp(scene, "AREA", (1.3, -0.4, 0.3), (0.0, 1.1, 0.0), shape="DISK")
    middle, coordinates = tree.nodes.new("ShaderNodeVectorMath"), tree.nodes.new("ShaderNodeTexCoord")
    middle.operation, middle.inputs[1].default_value = "DISTANCE", (0.5, 0.5, 0.0)
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].color, ramp.color_ramp.elements[1].color = (4.0, 3.0, 2.0, 1.0), (0.0, 0.0, 0.1, 1.0)
    ramp.color_ramp.elements[1].position = 0.5
    tree.links.new(coordinates.outputs["UV"], middle.inputs[0])
    tree.links.new(middle.outputs["Value"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], emission.inputs["Color"])
    tree, emission = _lamp(scene, "AREA", (0.0, 0.5, 1.2), (0.0, 0.0, 0.0))
    ies = tree.nodes.new("ShaderNodeTexIES")
    ies.ies = bpy.data.texts.new("Photometry")
    ies.ies.write(photometry(PLANES))
    ies.inputs["Strength"].default_value = 0.004
    tree.links.new(ies.outputs[0], emission.inputs["Strength"])
    tree, emission = _lamp(scene, "SUN", (0.0, 0.0, 3.0), (0.6, 0.3, 0.0))
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["UV"], emission.inputs["Color"])


def falloffs(scene):
    """Points and an area whose light falls less with distance, behind a pane and before."""
    _ball(scene)
    glass = stage.hunt.plain_material("Pane", "ShaderNodeBsdfTransparent", Color=(0.6, 0.8, 0.9, 1.0))
    stage.add_ball(scene, "Shell", 0.3, glass, (0.7, -0.3, -0.4))
    for place, kind, output, strength, smooth in (
        ((-1.2, -0.3, 0.4), "POINT", "Linear", 4.0, 0.0),
        ((1.2, -0.3, 0.4), "POINT", "Constant", 2.0, 0.6),
        ((0.0, 0.4, 1.2), "AREA", "Constant", 0.5, 0.0),
    ):
        tree, emission = _lamp(scene, kind, place, (0.0, 0.0, 0.0))
        falloff = tree.nodes.new("ShaderNodeLightFalloff")
        falloff.inputs["Strength"].default_value, falloff.inputs["Smooth"].default_value = strength, smooth
        tree.links.new(falloff.outputs[output], emission.inputs["Strength"])
        emission.inputs["Color"].default_value = (1.0, 0.7, 0.4, 1.0) if kind == "POINT" else (0.4, 0.6, 1.0, 1.0)


def photometry(planes):
    """Text of a photometric file with these horizontal angles."""
    rows = [
        " ".join(
            f"{900 * max(math.cos(math.radians(v / 2)), 0) * (1 + 0.4 * math.cos(math.radians(h))):.1f}" for v in ANGLES
        )
        for h in planes
    ]
    head = f"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 {len(ANGLES)} {len(planes)} 1 2 0 0 0\n1 1 60"
    return "\n".join([head, " ".join(map(str, ANGLES)), " ".join(map(str, planes)), *rows])


ENERGIES = {"SPOT": 40.0, "AREA": 8.0}


def _lamp(scene, kind, location, rotation, shape="RECTANGLE"):
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = ENERGIES.get(kind, 1.0)
    if kind in {"POINT", "SPOT"}:
        data.shadow_soft_size = 0.05
    if kind == "AREA":
        data.shape, data.size, data.size_y = shape, 0.8, 0.5
    if kind == "SUN":
        data.angle = 0.4
    if kind == "SPOT":
        data.spot_size, data.spot_blend = math.radians(70.0), 0.3
    lamp = bpy.data.objects.new(data.name, data)
    lamp.location, lamp.rotation_euler = location, rotation
    scene.collection.objects.link(lamp)
    if bpy.app.version < (5, 2, 0):
        data.use_nodes = True
    emission = next(node for node in data.node_tree.nodes if node.bl_idname == "ShaderNodeEmission")
    return data.node_tree, emission


def _picture():
    image = bpy.data.images.new("Window", 32, 32, float_buffer=True)
    bars = [[x % 8 < 5 and y % 16 < 12 for x in range(32)] for y in range(32)]
    image.pixels.foreach_set(
        [
            value
            for y, row in enumerate(bars)
            for x, lit in enumerate(row)
            for value in (lit, lit * y / 32, lit * x / 32, 1.0)
        ]
    )
    return image


def _ball(scene):
    material = stage.hunt.plain_material("Ball", Color=(0.7, 0.7, 0.7, 1.0))
    stage.add_ball(scene, "Ball", 0.5, material, (0.0, 0.0, -0.5))


SCENES = {"ies_lights": ies_lights, "gobo_spots": gobo_spots, "softboxes": softboxes, "falloffs": falloffs}
