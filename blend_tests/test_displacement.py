"""Meshes that their materials displace, as Cycles shows them."""

import json

import bpy
import numpy as np
import pytest

import cards as cards_module
from addon.engine.reading.scene import load_scene
from cards import Cards, differing_pixels, node
from helpers import update

QUADS = 16
"""Quads along the side of a card."""


@pytest.fixture
def cards(scene, monkeypatch):
    monkeypatch.setattr(cards_module, "PIXELS", 16)
    return Cards(scene, columns=4)


def grid(name, size=1.0, smooth=True, quads=QUADS):
    """A square of quads with a UV map."""
    mesh = bpy.data.meshes.new(name)
    side = np.arange(quads + 1) / quads
    points = [((x - 0.5) * size, (y - 0.5) * size, 0.0) for y in side for x in side]
    starts = [y * (quads + 1) + x for y in range(quads) for x in range(quads)]
    mesh.from_pydata(points, [], [(i, i + 1, i + quads + 2, i + quads + 1) for i in starts])
    uv = [[points[loop.vertex_index][axis] / size + 0.5 for axis in (0, 1)] for loop in mesh.loops]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.ravel(uv))
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    return mesh


def wave(tree, output="Fac"):
    """A wave over the card, askew."""
    uv = node(tree, "ShaderNodeTexCoord").outputs["UV"]
    turned = node(tree, "ShaderNodeMapping", {"Vector": uv, "Rotation": (0.0, 0.0, 0.6)}).outputs[0]
    return node(tree, "ShaderNodeTexWave", {"Vector": turned, "Scale": 0.4}).outputs[output]


def height(tree, scale=0.15, **settings):
    inputs = {"Height": wave(tree), "Midlevel": 0.25, "Scale": scale}
    return node(tree, "ShaderNodeDisplacement", inputs, **settings).outputs[0]


def vector(tree, **settings):
    """A displacement by all axes, another one each."""
    parts = node(tree, "ShaderNodeCombineXYZ", {"X": 0.3, "Y": wave(tree), "Z": -0.2}).outputs[0]
    inputs = {"Vector": parts, "Midlevel": 0.1, "Scale": 0.1}
    return node(tree, "ShaderNodeVectorDisplacement", inputs, **settings).outputs[0]


def look(tree, normal=None):
    """A colour that tells the normal across the view, and the height."""
    geometry = node(tree, "ShaderNodeNewGeometry")
    parts = node(tree, "ShaderNodeSeparateXYZ", {0: normal or geometry.outputs["Normal"]}).outputs
    place = node(tree, "ShaderNodeSeparateXYZ", {0: geometry.outputs["Position"]}).outputs
    halved = [node(tree, "ShaderNodeMath", {0: part, 1: 0.5, 2: 0.5}, operation="MULTIPLY_ADD") for part in parts[:2]]
    raised = node(tree, "ShaderNodeMath", {0: place[2], 1: 3.0, 2: 0.5}, operation="MULTIPLY_ADD")
    inputs = dict(zip("XYZ", (*(half.outputs[0] for half in halved), raised.outputs[0]), strict=True))
    return node(tree, "ShaderNodeCombineXYZ", inputs).outputs[0]


def add(cards, name, offset, method="DISPLACEMENT", scale=1.0, smooth=True, shown=look):
    """A card of many quads with a displacement."""
    tree, output = cards.add(name)
    card, material = cards.scene.objects[name], bpy.data.materials[name]
    card.data = grid(name, 1.0 / scale, smooth)
    card.data.materials.append(material)
    card.scale = (scale,) * 3
    material.displacement_method = method
    tree.links.new(offset(tree), output.inputs["Displacement"])
    cards.show(tree, output, shown(tree))
    return card


def described_scene(scene):
    return json.loads(load_scene(scene).summary())


def test_heights_displace_meshes_as_in_cycles(cards, tmp_path):
    for method in ("DISPLACEMENT", "BOTH"):
        add(cards, f"plain {method}", height, method)
        add(cards, f"flat {method}", height, method, smooth=False)
        for space in ("OBJECT", "WORLD"):
            add(cards, f"{space} {method}", lambda tree, space=space: height(tree, 0.07, space=space), method, 2.0)
    assert differing_pixels(cards, tmp_path) == ({}, [])


def test_vectors_displace_meshes_as_in_cycles(cards, tmp_path):
    for space in ("TANGENT", "OBJECT", "WORLD"):
        card = add(cards, space, lambda tree, space=space: vector(tree, space=space))
        card.rotation_euler.z = 0.2
    add(cards, "BOTH", lambda tree: vector(tree, space="TANGENT"), "BOTH")
    assert differing_pixels(cards, tmp_path) == ({}, [])


def test_materials_sharp_faces_and_maps_of_displaced_meshes_are_those_of_cycles(cards, tmp_path):
    halves = add(cards, "halves", height)
    other = halves.data.materials[0].copy()
    other.displacement_method = "BUMP"
    other.node_tree.links.remove(next(link for link in other.node_tree.links if link.to_socket.name == "Displacement"))
    halves.data.materials.append(other)
    halves.data.polygons.foreach_set("material_index", [i % QUADS // (QUADS // 2) for i in range(QUADS**2)])
    for method in ("DISPLACEMENT", "BOTH"):
        sharp = add(cards, f"sharp {method}", height, method)
        sharp.data.polygons.foreach_set("use_smooth", [i // QUADS < QUADS // 2 for i in range(QUADS**2)])
    add(cards, "generated", height, shown=lambda tree: node(tree, "ShaderNodeTexCoord").outputs["Generated"])
    map_inputs = {"Color": (0.6, 0.7, 0.9, 1.0)}
    mapped = lambda tree: look(tree, node(tree, "ShaderNodeNormalMap", map_inputs).outputs[0])  # noqa: E731
    add(cards, "normal map", height, shown=mapped)
    if bpy.app.version >= (5, 2, 0):
        tree = bpy.data.materials["normal map"].node_tree
        next(each for each in tree.nodes if each.bl_idname == "ShaderNodeNormalMap").base = "ORIGINAL"
        add(cards, "normal map of the displaced", height, shown=mapped)
    assert differing_pixels(cards, tmp_path) == ({}, [])


def test_meshes_are_displaced_by_the_materials_that_their_objects_show(cards):
    card = add(cards, "card", height)
    plain = bpy.data.materials.new("Plain")
    other = bpy.data.objects.new("other", card.data)
    cards.scene.collection.objects.link(other)
    other.material_slots[0].link = "OBJECT"
    other.material_slots[0].material = plain
    update()
    described = described_scene(cards.scene)
    by_name = {instance["name"]: described["meshes"][instance["mesh"]] for instance in described["instances"]}
    assert by_name["card"]["displaced"]
    assert not by_name["other"]["displaced"]
    cards.scene.view_layers[0].material_override = plain
    update()
    assert not any(mesh["displaced"] for mesh in described_scene(cards.scene)["meshes"])
