"""Every value node, exported and evaluated by Relume, has the values that Cycles gives it.

A plane emits what the node computes from its UV coordinates and normal, seen by an orthographic camera: no light
transport is left, so both pictures agree to within the antialiasing's noise.
"""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add_material, add_quad, render_cycles

pytestmark = pytest.mark.every_version

SIZE = 16


@pytest.fixture
def emitter(scene):
    """A plane whose emission is free; returns the tree, a source of UV coordinates and the emission node."""
    material, tree, output = add_material("Emitter")
    emission = tree.nodes.new("ShaderNodeEmission")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    plane = add_quad(scene, "Plane", size=2.0, material=material)
    plane.color, plane.pass_index = (0.2, 0.4, 0.8, 1.0), 3
    plane.location, plane.rotation_euler = (0.0, 0.1, 0.3), (0.4, 0.2, 0.1)
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 1.6
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.world = bpy.data.worlds.new("Black")
    return tree, coordinates, emission


def compare(scene, tmp_path):
    """Relume's and Cycles' pictures, top row first."""
    folder = tmp_path / "bake"
    settings = trace_settings(scene, lambda _: None) | {"samples": 256}
    relume.bake(load_scene(scene), folder, settings).wait()
    ours = relume.Relighter(folder).relight("[]", denoise=False)["combined"]
    return ours, render_cycles(scene, samples=256)[::-1]


def assert_equal(scene, tmp_path, tolerance=0.02):
    ours, cycles = compare(scene, tmp_path)
    scale = max(np.abs(cycles).max(), 1e-3)
    assert np.abs(cycles).max() > 1e-3, "the test shows something"
    assert np.abs(ours - cycles).mean() / scale < tolerance / 2
    assert np.abs(ours - cycles).max() / scale < 5 * tolerance


def add_node(tree, coordinates, kind, settings, inputs):
    """A node; inputs are values, "uv", or "u" (its first component)."""
    node = tree.nodes.new(kind)
    for name, value in settings.items():
        setattr(node, name, value)
    for key, value in inputs.items():
        socket = next((socket for socket in node.inputs if socket.identifier == key), None) or node.inputs[key]
        if value == "uv":
            tree.links.new(coordinates.outputs["UV"], socket)
        elif value == "u":
            separate = tree.nodes.new("ShaderNodeSeparateXYZ")
            tree.links.new(coordinates.outputs["UV"], separate.inputs[0])
            tree.links.new(separate.outputs[0], socket)
        else:
            socket.default_value = value
    return node


GREY = (0.2, 0.5, 0.7, 1.0)
# Kind, settings, inputs, output.
NODES = {
    "mapping point": ("ShaderNodeMapping", {}, {"Vector": "uv", "Location": (0.1, 0.2, 0), "Rotation": (0, 0, 0.5)}, 0),
    "mapping texture": (
        "ShaderNodeMapping",
        {"vector_type": "TEXTURE"},
        {"Vector": "uv", "Location": (0.1, -0.2, 0), "Rotation": (0.2, 0, -0.5), "Scale": (2, 0.5, 1)},
        0,
    ),
    "math power": ("ShaderNodeMath", {"operation": "POWER"}, {0: "u", 1: 2.5}, 0),
    "math pingpong": ("ShaderNodeMath", {"operation": "PINGPONG"}, {0: "u", 1: 0.3}, 0),
    "math clamp": ("ShaderNodeMath", {"operation": "MULTIPLY_ADD", "use_clamp": True}, {0: "u", 1: 3.0, 2: -0.5}, 0),
    "vector math": (
        "ShaderNodeVectorMath",
        {"operation": "MULTIPLY_ADD"},
        {0: "uv", 1: (2, 1, 0), 2: (0, 0.3, 0.4)},
        0,
    ),
    "vector length": ("ShaderNodeVectorMath", {"operation": "LENGTH"}, {0: "uv"}, 1),
    "vector scale": ("ShaderNodeVectorMath", {"operation": "SCALE"}, {0: "uv", "Scale": 0.4}, 0),
    "map range": ("ShaderNodeMapRange", {"interpolation_type": "SMOOTHSTEP"}, {"Value": "u", "To Max": 2.0}, 0),
    "clamp": ("ShaderNodeClamp", {}, {"Value": "u", "Min": 0.3, "Max": 0.6}, 0),
    "mix float": ("ShaderNodeMix", {}, {"Factor_Float": "u", "A_Float": 0.2, "B_Float": 0.9}, 0),
    "mix vector": ("ShaderNodeMix", {"data_type": "VECTOR"}, {"A_Vector": "uv", "B_Vector": (0.3, 0.1, 0.9)}, 1),
    "mix overlay": (
        "ShaderNodeMix",
        {"data_type": "RGBA", "blend_type": "OVERLAY"},
        {"Factor_Float": 0.7, "A_Color": "uv", "B_Color": GREY},
        2,
    ),
    "mix hue": (
        "ShaderNodeMix",
        {"data_type": "RGBA", "blend_type": "HUE"},
        {"Factor_Float": 0.7, "A_Color": "uv", "B_Color": GREY},
        2,
    ),
    "ramp": ("ShaderNodeValToRGB", {}, {0: "u"}, 0),
    "curves": ("ShaderNodeRGBCurve", {}, {1: "uv"}, 0),
    "hue saturation": ("ShaderNodeHueSaturation", {}, {"Hue": 0.6, "Saturation": 1.4, "Value": 0.8, "Color": "uv"}, 0),
    "bright contrast": ("ShaderNodeBrightContrast", {}, {"Color": "uv", 1: 0.1, "Contrast": 0.3}, 0),
    "gamma": ("ShaderNodeGamma", {}, {"Color": "uv", "Gamma": 2.2}, 0),
    "invert": ("ShaderNodeInvert", {}, {0: 0.8, "Color": "uv"}, 0),
    "separate hsv": ("ShaderNodeSeparateColor", {"mode": "HSV"}, {0: "uv"}, 0),
    "combine hsv": ("ShaderNodeCombineColor", {"mode": "HSV"}, {0: "u", 1: 0.8, 2: 0.9}, 0),
    "combine xyz": ("ShaderNodeCombineXYZ", {}, {"X": "u", "Y": 0.4}, 0),
    "to grey": ("ShaderNodeRGBToBW", {}, {0: "uv"}, 0),
    "fresnel": ("ShaderNodeFresnel", {}, {"IOR": 1.8}, 0),
    "layer weight": ("ShaderNodeLayerWeight", {}, {"Blend": 0.6}, "Facing"),
    "layer fresnel": ("ShaderNodeLayerWeight", {}, {"Blend": 0.6}, "Fresnel"),
    "geometry normal": ("ShaderNodeNewGeometry", {}, {}, "Normal"),
    "geometry incoming": ("ShaderNodeNewGeometry", {}, {}, "Incoming"),
    "object color": ("ShaderNodeObjectInfo", {}, {}, "Color"),
    "object random": ("ShaderNodeObjectInfo", {}, {}, "Random"),
    "object index": ("ShaderNodeObjectInfo", {}, {}, "Object Index"),
    "noise": ("ShaderNodeTexNoise", {}, {"Scale": 3.0, "Detail": 1.5, "Distortion": 0.3}, 1),
    "noise at uv": ("ShaderNodeTexNoise", {"noise_dimensions": "2D"}, {"Vector": "uv", "Scale": 3.0}, 0),
    "noise of w": ("ShaderNodeTexNoise", {"noise_dimensions": "1D"}, {"W": "u", "Scale": 5.0}, 0),
    "white noise": ("ShaderNodeTexWhiteNoise", {"noise_dimensions": "1D"}, {"W": 0.37}, 1),
    "checker": ("ShaderNodeTexChecker", {}, {"Scale": 2.0}, 0),
    "gradient": ("ShaderNodeTexGradient", {"gradient_type": "EASING"}, {}, 1),
    "voronoi": ("ShaderNodeTexVoronoi", {"normalize": True}, {"Scale": 2.0, "Detail": 1.0}, 0),
    "voronoi position": ("ShaderNodeTexVoronoi", {"feature": "SMOOTH_F1"}, {"Scale": 2.0, "Vector": "uv"}, 2),
    "voronoi edge": ("ShaderNodeTexVoronoi", {"feature": "DISTANCE_TO_EDGE"}, {"Scale": 2.0}, 0),
    "wave": ("ShaderNodeTexWave", {"wave_type": "RINGS"}, {"Scale": 0.3, "Distortion": 1.0}, 0),
    "magic": ("ShaderNodeTexMagic", {}, {"Scale": 0.5}, 0),
    "brick": ("ShaderNodeTexBrick", {}, {"Scale": 1.3, "Mortar Size": 0.1, "Mortar Smooth": 1.0}, 0),
}


@pytest.mark.parametrize("name", NODES)
def test_value_matches_cycles(scene, emitter, tmp_path, name):
    tree, coordinates, emission = emitter
    kind, settings, inputs, output = NODES[name]
    node = add_node(tree, coordinates, kind, settings, inputs)
    if name == "ramp":
        node.color_ramp.interpolation = "EASE"
        node.color_ramp.elements.new(0.4).color = (0.9, 0.1, 0.3, 1.0)
    if name == "curves":
        node.mapping.curves[3].points.new(0.5, 0.7)
        node.mapping.curves[0].points.new(0.3, 0.6)
    tree.links.new(node.outputs[output], emission.inputs["Color"])
    assert_equal(scene, tmp_path)


@pytest.mark.parametrize("output", ["Generated", "Object", "Normal", "UV", "Window", "Reflection"])
def test_coordinates_match_cycles(scene, emitter, tmp_path, output):
    tree, coordinates, emission = emitter
    tree.links.new(coordinates.outputs[output], emission.inputs["Color"])
    assert_equal(scene, tmp_path)


@pytest.mark.parametrize("interpolation", ["Linear", "Closest", "Cubic"])
@pytest.mark.parametrize("extension", ["REPEAT", "EXTEND", "CLIP"])
def test_images_match_cycles(scene, emitter, tmp_path, interpolation, extension):
    tree, coordinates, emission = emitter
    image = bpy.data.images.new("Noise", 5, 4)
    image.pixels.foreach_set(np.random.default_rng(1).random(5 * 4 * 4, dtype=np.float32))
    image.pack()
    node = add_node(tree, coordinates, "ShaderNodeTexImage", {"image": image, "extension": extension}, {})
    node.interpolation = interpolation
    mapping = add_node(tree, coordinates, "ShaderNodeMapping", {}, {"Vector": "uv", "Scale": (1.7, 1.4, 1)})
    tree.links.new(mapping.outputs[0], node.inputs["Vector"])
    tree.links.new(node.outputs["Color"], emission.inputs["Color"])
    assert_equal(scene, tmp_path, tolerance=0.04)


def test_color_attributes_match_cycles(scene, emitter, tmp_path):
    tree, _, emission = emitter
    colors = bpy.data.objects["Plane"].data.color_attributes.new("Paint", "BYTE_COLOR", "POINT")
    colors.data.foreach_set("color", np.random.default_rng(2).random(16, dtype=np.float32))
    node = tree.nodes.new("ShaderNodeVertexColor")
    node.layer_name = "Paint"
    tree.links.new(node.outputs["Color"], emission.inputs["Color"])
    assert_equal(scene, tmp_path)


@pytest.mark.parametrize("output", ["Color", "Vector", "Fac", "Alpha"])
@pytest.mark.parametrize(
    "kind, domain, width",
    [
        ("FLOAT", "POINT", 1),
        ("FLOAT", "FACE", 1),
        ("FLOAT_VECTOR", "CORNER", 3),
        ("FLOAT_COLOR", "FACE", 4),
        ("BOOLEAN", "POINT", 1),
    ],
)
def test_attributes_match_cycles(scene, emitter, tmp_path, kind, domain, width, output):
    tree, _, emission = emitter
    mesh = bpy.data.objects["Plane"].data
    corners = [(-1, -1, 0), (1, -1, 0), (1, 0, 0), (-1, 0, 0), (1, 1, 0), (-1, 1, 0)]
    mesh.clear_geometry()
    mesh.from_pydata(corners, [], [(0, 1, 2, 3), (3, 2, 4, 5)])
    attribute = mesh.attributes.new("mask", kind, domain)
    values = np.random.default_rng(2).random(len(attribute.data) * width, dtype=np.float32)
    field = {1: "value", 3: "vector", 4: "color"}[width]
    attribute.data.foreach_set(field, values > 0.5 if kind == "BOOLEAN" else values)
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "mask"
    socket = next(socket for socket in node.outputs if socket.identifier == output)
    tree.links.new(socket, emission.inputs["Color"])
    assert_equal(scene, tmp_path)


def test_a_uv_map_by_its_name_as_attribute_matches_cycles(scene, emitter, tmp_path):
    tree, _, emission = emitter
    node = tree.nodes.new("ShaderNodeAttribute")
    node.attribute_name = "UVMap"
    tree.links.new(node.outputs["Vector"], emission.inputs["Strength"])
    assert_equal(scene, tmp_path)


def test_generated_coordinates_are_those_before_modifiers(scene, emitter, tmp_path):
    tree, coordinates, emission = emitter
    plane = bpy.data.objects["Plane"]
    modifier = plane.modifiers.new("Smooth", "SUBSURF")
    modifier.levels = modifier.render_levels = 2
    tree.links.new(coordinates.outputs["Generated"], emission.inputs["Color"])
    assert_equal(scene, tmp_path)
