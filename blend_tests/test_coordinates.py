"""Where textures and attributes are taken is where Cycles takes them."""

import bpy
import numpy as np
import pytest

from cards import Cards, differences

pytestmark = pytest.mark.every_version

KINDS = {
    "FLOAT": ("value", 1),
    "INT": ("value", 1),
    "BOOLEAN": ("value", 1),
    "FLOAT2": ("vector", 2),
    "FLOAT_VECTOR": ("vector", 3),
    "FLOAT_COLOR": ("color", 4),
    "BYTE_COLOR": ("color", 4),
}
"""Types of attributes, with the field of their values and how many each has."""
MAPPINGS = {
    "point": {"translation": (0.1, 0.2, 0.0), "rotation": (0.0, 0.0, 0.5), "scale": (2.0, 3.0, 1.0)},
    "texture": {"vector_type": "TEXTURE", "translation": (0.1, -0.2, 0.0), "scale": (0.4, 2.0, 1.0)},
    "vector": {"vector_type": "VECTOR", "translation": (0.3, 0.3, 0.0), "rotation": (0.2, 0.0, 1.0)},
    "normal": {"vector_type": "NORMAL", "scale": (0.5, 2.0, 1.0)},
    "axes": {"mapping_x": "Y", "mapping_y": "X", "mapping_z": "NONE", "scale": (3.0, 1.0, 1.0)},
    "limits": {"use_min": True, "min": (0.3, 0.2, 0.0), "scale": (2.0, 2.0, 1.0)},
    "both limits": {"use_min": True, "min": (0.3, 0.2, 0.0), "use_max": True, "max": (0.8, 0.6, 1.0)},
}


def test_mapping_in_the_properties_of_a_texture_counts(scene, tmp_path):
    image = bpy.data.images.new("Noise", 8, 8)
    image.pixels.foreach_set(np.random.default_rng(1).random(8 * 8 * 4, dtype=np.float32))
    image.pack()
    cards = Cards(scene, columns=7)
    for kind in ("ShaderNodeTexImage", "ShaderNodeTexGradient", "ShaderNodeTexMagic"):
        for name, settings in MAPPINGS.items():
            tree, output = cards.add(f"{kind} {name}")
            texture = tree.nodes.new(kind)
            if kind == "ShaderNodeTexImage":
                texture.image = image
            else:
                coordinates = tree.nodes.new("ShaderNodeTexCoord")
                tree.links.new(coordinates.outputs["UV"], texture.inputs["Vector"])
            for setting, value in settings.items():
                setattr(texture.texture_mapping, setting, value)
            cards.show(tree, output, texture.outputs[0])
    means, warnings = cards.means(tmp_path, samples=128)
    assert differences(means, tolerance=0.05) == {}
    assert warnings == []


@pytest.mark.parametrize("domain", ["POINT", "CORNER", "FACE"])
def test_attributes_of_any_type_serve_as_uv_maps(scene, tmp_path, domain):
    random = np.random.default_rng(3)
    cards = Cards(scene)
    for kind, (field, width) in KINDS.items():
        for output in ("UV", "Vector", "Fac", "Alpha"):
            tree, surface = cards.add(f"{kind} {output}")
            attribute = scene.objects[f"{kind} {output}"].data.attributes.new("flow", kind, domain)
            values = random.random(len(attribute.data) * width, dtype=np.float32)
            attribute.data.foreach_set(field, (values > 0.5 if kind in {"INT", "BOOLEAN"} else values).tolist())
            if output == "UV":
                reader = tree.nodes.new("ShaderNodeUVMap")
                reader.uv_map = "flow"
            else:
                reader = tree.nodes.new("ShaderNodeAttribute")
                reader.attribute_name = "flow"
            socket = next(socket for socket in reader.outputs if socket.identifier == output)
            cards.show(tree, surface, socket)
    means, warnings = cards.means(tmp_path, samples=32)
    assert differences(means, tolerance=0.05) == {}
    assert warnings == []


def test_what_a_mesh_lacks_is_black_and_opaque(scene, tmp_path):
    cards = Cards(scene)
    for name in ("no UV map", "no such UV map", "no attribute"):
        tree, surface = cards.add(name)
        if name == "no UV map":
            mesh = scene.objects[name].data
            mesh.uv_layers.remove(mesh.uv_layers[0])
        reader = tree.nodes.new("ShaderNodeAttribute" if name == "no attribute" else "ShaderNodeUVMap")
        setattr(
            reader,
            *{"no attribute": ("attribute_name", "x"), "no such UV map": ("uv_map", "x")}.get(name, ("label", "")),
        )
        cards.show(tree, surface, reader.outputs["Alpha" if name == "no attribute" else "UV"])
    assert differences(cards.means(tmp_path)[0]) == {}


def displaced(tree, output, height, scale=0.3, **settings):
    node = tree.nodes.new("ShaderNodeDisplacement")
    for name, value in settings.items():
        setattr(node, name, value)
    node.inputs["Scale"].default_value = scale
    tree.links.new(height, node.inputs["Height"])
    tree.links.new(node.outputs[0], output.inputs["Displacement"])


@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_displacement_that_is_only_looked_at_bumps_the_surface(scene, tmp_path, space):
    """The normal that a shader sees, of a plain and of a scaled card."""
    cards = Cards(scene)
    for name, scale in (("plain", 1.0), ("scaled", 2.0), ("flat", 1.0)):
        tree, output = cards.add(name)
        card = scene.objects[name]
        card.data.transform(((1 / scale, 0, 0, 0), (0, 1 / scale, 0, 0), (0, 0, 1 / scale, 0), (0, 0, 0, 1)))
        card.scale = (scale,) * 3
        wave = tree.nodes.new("ShaderNodeTexGradient")
        coordinates = tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
        weight = tree.nodes.new("ShaderNodeLayerWeight")
        cards.show(tree, output, weight.outputs["Facing"])
        if name != "flat":
            displaced(tree, output, wave.outputs[0], space=space)
    means, warnings = cards.means(tmp_path, samples=32)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


def short_normal(tree):
    """A vector of another length than 1, which Blender does not know to be constant."""
    checker, made = tree.nodes.new("ShaderNodeTexChecker"), tree.nodes.new("ShaderNodeCombineXYZ")
    checker.inputs["Scale"].default_value = 0.0
    tree.links.new(checker.outputs["Fac"], made.inputs["Y"])
    made.inputs["X"].default_value, made.inputs["Z"].default_value = 0.1, 0.5
    return made.outputs[0]


def test_bump_and_facing_take_normals_of_any_length(scene, tmp_path):
    cards = Cards(scene)
    for name, kind, output in (
        ("bump", "ShaderNodeBump", "Normal"),
        ("facing", "ShaderNodeLayerWeight", "Facing"),
        ("fresnel", "ShaderNodeFresnel", 0),
    ):
        tree, surface = cards.add(name)
        node = tree.nodes.new(kind)
        tree.links.new(short_normal(tree), node.inputs["Normal"])
        if kind == "ShaderNodeBump":
            coordinates, wave = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeTexWave")
            tree.links.new(coordinates.outputs["UV"], wave.inputs["Vector"])
            wave.inputs["Scale"].default_value, node.inputs["Distance"].default_value = 0.4, 0.2
            tree.links.new(wave.outputs[0], node.inputs["Height"])
        cards.show(tree, surface, node.outputs[output])
    assert differences(cards.means(tmp_path, samples=64)[0], tolerance=0.04) == {}
