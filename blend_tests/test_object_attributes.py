"""Attributes of objects, instancers, view layers and edges are those of Cycles."""

import bpy
import numpy as np
import pytest

from addon.engine.reading.scene import load_scene
from cards import Cards, differences, node

pytestmark = pytest.mark.every_version

OUTPUTS = ("Color", "Vector", "Fac", "Alpha")


def show_attribute(cards, name, kind, asked, outputs=OUTPUTS):
    """Cards that show an attribute."""
    for output in outputs:
        tree, surface = cards.add(f"{name} {output}")
        reader = node(tree, "ShaderNodeAttribute", attribute_type=kind, attribute_name=asked)
        cards.show(tree, surface, next(socket for socket in reader.outputs if socket.identifier == output))
        yield bpy.context.scene.objects[f"{name} {output}"]


VALUES = {
    "number": 0.7,
    "whole": 2,
    "flag": True,
    "two": [0.3, 0.6],
    "color": [0.2, 0.5, 0.8, 0.4],
    "five": [0.1] * 5,
    "words": "nothing",
}


@pytest.mark.parametrize("kind", ["OBJECT", "INSTANCER"])
def test_custom_properties_of_objects(scene, tmp_path, kind):
    cards = Cards(scene)
    for name, value in VALUES.items():
        for card in show_attribute(cards, name, kind, "mine"):
            card["mine"] = value
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    assert warnings == []


PATHS = {
    *("color", "location", "location[1]", "rotation_euler", "rotation_quaternion", "scale", "pass_index", "data.my"),
    *("my", "show_name", "lock_location", "name", "type", "matrix_world", "nowhere"),
}


def test_properties_of_objects_and_their_data(scene, tmp_path):
    cards = Cards(scene, columns=10)
    for path in sorted(PATHS):
        for card in show_attribute(cards, path, "OBJECT", path):
            card.color, card.pass_index, card.show_name = (0.1, 0.4, 0.7, 0.6), 3, True
            card.data["my"] = 0.35
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    assert warnings == []


def test_attributes_of_the_view_layer_its_scene_and_world(scene, tmp_path):
    scene.world = bpy.data.worlds.new("World")
    bpy.context.view_layer["of layer"], scene["of scene"], scene.world["of world"] = 0.3, [0.2, 0.4, 0.9], 0.6
    bpy.context.view_layer["both"], scene["both"] = 0.1, 0.9
    cards = Cards(scene)
    for name in ("of layer", "of scene", "of world", "both", "samples", "frame_current", "nothing"):
        list(show_attribute(cards, name, "VIEW_LAYER", name))
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    assert warnings == []


def test_instances_have_values_and_coordinates_of_their_instancer(scene, tmp_path):
    """Cards that instance a card on the middle of their face."""
    cards = Cards(scene)
    readers = {
        "attribute": ("ShaderNodeAttribute", "Color", {"attribute_type": "INSTANCER", "attribute_name": "mine"}),
        "own": ("ShaderNodeAttribute", "Color", {"attribute_type": "OBJECT", "attribute_name": "mine"}),
        "generated": ("ShaderNodeTexCoord", "Generated", {"from_instancer": True}),
        "uv": ("ShaderNodeTexCoord", "UV", {"from_instancer": True}),
        "uv map": ("ShaderNodeUVMap", "UV", {"from_instancer": True}),
        "object": ("ShaderNodeTexCoord", "Object", {"from_instancer": True}),
    }
    for name, (kind, output, settings) in readers.items():
        tree, surface = cards.add(name)
        cards.show(tree, surface, node(tree, kind, **settings).outputs[output])
        card = scene.objects[name]
        base = bpy.data.objects.new(f"base of {name}", card.data.copy())
        scene.collection.objects.link(base)
        base.data.materials.clear()
        base.location, base.instance_type = card.location, "FACES"
        base.show_instancer_for_render = False
        card.parent, card.location = base, (0.0, 0.0, 0.0)
        base["mine"], card["mine"] = [0.2, 0.6, 0.9], 0.4
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


@pytest.mark.parametrize("kind", ["FLOAT", "INT", "INT8", "BOOLEAN", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR"])
def test_attributes_of_edges_are_means_at_vertices(scene, tmp_path, kind):
    field, width = {"FLOAT": ("value", 1), "INT": ("value", 1), "INT8": ("value", 1), "BOOLEAN": ("value", 1)}.get(
        kind, ("color", 4) if kind == "FLOAT_COLOR" else ("vector", 2 if kind == "FLOAT2" else 3)
    )
    cards = Cards(scene)
    for card in show_attribute(cards, kind, "GEOMETRY", "flow"):
        attribute = card.data.attributes.new("flow", kind, "EDGE")
        values = np.random.default_rng(3).random(len(attribute.data) * width, dtype=np.float32)
        if kind in {"INT", "INT8"}:
            values = np.int32(values * 12) - 3
        attribute.data.foreach_set(field, (values > 0.5 if kind == "BOOLEAN" else values).tolist())
    means, warnings = cards.means(tmp_path, samples=32)
    assert differences(means, tolerance=0.05) == {}
    assert warnings == []


def test_values_of_objects_within_volumes_are_said(scene):
    cards = Cards(scene)
    tree, output = cards.add("fog")
    reader = node(tree, "ShaderNodeAttribute", attribute_type="OBJECT", attribute_name="color")
    fog = node(tree, "ShaderNodeVolumeScatter", {"Color": reader.outputs["Color"]})
    tree.links.new(fog.outputs[0], output.inputs["Volume"])
    assert any("not known within volumes" in warning for warning in load_scene(scene).warnings)
