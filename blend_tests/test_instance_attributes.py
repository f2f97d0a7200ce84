"""Attributes that geometry nodes give their instances are those of Cycles."""

import bpy
import numpy as np
import pytest

from cards import Cards, node
from helpers import add, exported
from instances import instancing, unlinked

pytestmark = pytest.mark.every_version

SIDE = 0.5
PLACES = [(-0.25, -0.25, 0.0), (0.25, -0.25, 0.0), (-0.25, 0.25, 0.0), (0.25, 0.25, 0.0)]


class Scattering:
    """Nodes that show something at the four places of a card."""

    def __init__(self, material):
        self.tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
        for in_out in ("INPUT", "OUTPUT"):
            self.tree.interface.new_socket("Geometry", in_out=in_out, socket_type="NodeSocketGeometry")
        self.points = self.node("NodeGroupInput").outputs[0]
        square = self.node("GeometryNodeMeshGrid", {"Size X": SIDE, "Size Y": SIDE}).outputs[0]
        colored = self.node("GeometryNodeSetMaterial", {"Geometry": square})
        colored.inputs["Material"].default_value = material
        self.square = colored.outputs[0]

    def node(self, kind, inputs=None, **settings):
        return node(self.tree, kind, inputs, **settings)

    def at_places(self, instance, **inputs):
        inputs |= {"Points": self.points, "Instance": instance}
        return self.node("GeometryNodeInstanceOnPoints", inputs).outputs[0]

    def store(self, instances, name, kind="FLOAT", scale=0.2):
        """Instances with an attribute that depends on their index."""
        index = self.node("GeometryNodeInputIndex").outputs[0]
        made = self.node("ShaderNodeMath", {0: index, 1: scale}, operation="MULTIPLY").outputs[0]
        if kind in {"FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR"}:
            made = self.node("ShaderNodeCombineXYZ", {"X": made, "Y": 0.3, "Z": 0.7}).outputs[0]
        if kind in {"INT", "BOOLEAN"}:
            made = index
        inputs = {"Geometry": instances, "Name": name}
        stored = self.node("GeometryNodeStoreNamedAttribute", inputs, data_type=kind, domain="INSTANCE")
        value = next(socket for socket in stored.inputs if socket.name == "Value" and socket.enabled)
        self.tree.links.new(made, value)
        return stored.outputs[0]

    def done(self, geometry):
        self.node("NodeGroupOutput", {"Geometry": geometry})
        return self.tree


def add_card(cards, name, nodes, asked="mine", output="Color"):
    """A card of instances that show what their instancer has of a name."""
    tree, surface = cards.add(name)
    reader = node(tree, "ShaderNodeAttribute", attribute_type="INSTANCER", attribute_name=asked)
    cards.show(tree, surface, next(socket for socket in reader.outputs if socket.identifier == output))
    card = bpy.context.scene.objects[name]
    material = card.data.materials[0]
    card.data = bpy.data.meshes.new(name)
    card.data.from_pydata(PLACES, [], [])
    card["mine"] = [0.9, 0.1, 0.5]
    card.modifiers.new("Scatter", "NODES").node_group = nodes(Scattering(material), material)
    return card


def plain(kind):
    return lambda made, _material: made.done(made.store(made.at_places(made.square), "mine", kind))


def other_name(made, _material):
    return made.done(made.store(made.at_places(made.square), "other"))


def outer_or_inner(first, second):
    """Instances of instances, with an attribute of either."""

    def nodes(made, _material):
        inner = made.store(made.at_places(made.square), first)
        return made.done(made.store(made.at_places(inner, Scale=(0.5, 0.5, 0.5)), second, scale=0.3))

    return nodes


def beside_others(made, _material):
    """Instances with points and curves of the same object."""
    instances = made.store(made.at_places(made.square), "mine")
    inputs = [instances, made.points, made.node("GeometryNodeCurvePrimitiveLine").outputs[0]]
    join = made.node("GeometryNodeJoinGeometry")
    for each in inputs:
        made.tree.links.new(each, join.inputs[0])
    return made.done(join.outputs[0])


def numbered(made, _material):
    """Instances whose numbers do not follow their order, of two of which they are the same."""
    index = made.node("GeometryNodeInputIndex").outputs[0]
    number = made.node("ShaderNodeMath", {0: 7.0, 1: index}, operation="SUBTRACT").outputs[0]
    points = made.node("GeometryNodeSetID", {"Geometry": made.points, "ID": number}).outputs[0]
    instances = made.node("GeometryNodeInstanceOnPoints", {"Points": points, "Instance": made.square})
    return made.done(made.store(instances.outputs[0], "mine"))


def square_object(material):
    made = bpy.data.objects.new("Square", bpy.data.meshes.new("Square"))
    half = SIDE / 2
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)]
    made.data.from_pydata(corners, [], [(0, 1, 2, 3)])
    made.data.materials.append(material)
    return made


def of_object(made, material):
    square = square_object(material)
    bpy.context.scene.collection.objects.link(square)
    square.hide_render = True
    info = made.node("GeometryNodeObjectInfo", {"As Instance": True})
    info.inputs["Object"].default_value = square
    geometry = next(socket for socket in info.outputs if socket.identifier == "Geometry")
    return made.done(made.store(made.at_places(geometry), "mine"))


def of_collection(made, material):
    info = made.node("GeometryNodeCollectionInfo")
    info.inputs["Collection"].default_value = unlinked("Squares", square_object(material))
    return made.done(made.store(made.at_places(info.outputs[0]), "mine"))


def by_place(image):
    """Mean colour at each of the four places: now and then Cycles sees through a seam between two squares."""
    rows, columns, _ = image.shape
    return image[..., :3].reshape(2, rows // 2, 2, columns // 2, 3).mean(axis=(1, 3))


def compared(cards, tmp_path):
    """Cards whose places differ, and warnings."""
    cards.scene.cycles.pixel_filter_type = "BOX"
    pixels, warnings = cards.pixels(tmp_path)
    places = {name: [by_place(image) for image in pair] for name, pair in pixels.items()}
    wrong = {
        name: (ours.round(2).tolist(), cycles.round(2).tolist())
        for name, (ours, cycles) in places.items()
        if np.abs(ours - cycles).max() > 0.02
    }
    return wrong, warnings


@pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="Python cannot read instances of nodes yet")
def test_attributes_of_instances(scene, tmp_path):
    cards = Cards(scene)
    for kind in ("FLOAT", "INT", "BOOLEAN", "FLOAT2", "FLOAT_VECTOR", "FLOAT_COLOR", "BYTE_COLOR"):
        add_card(cards, kind, plain(kind))
    for output in ("Fac", "Vector"):
        add_card(cards, output, plain("FLOAT_COLOR"), output=output)
    add_card(cards, "position", plain("FLOAT"), asked="position")
    add_card(cards, "transform", plain("FLOAT"), asked="instance_transform")
    add_card(cards, "other name", other_name)
    add_card(cards, "inner and outer", outer_or_inner("mine", "mine"))
    add_card(cards, "outer", outer_or_inner("other", "mine"))
    add_card(cards, "inner", outer_or_inner("mine", "other"))
    add_card(cards, "beside others", beside_others)
    add_card(cards, "numbered", numbered)
    add_card(cards, "object", of_object)
    add_card(cards, "collection", of_collection)
    placed = add_card(cards, "in a collection", plain("FLOAT"))
    scene.collection.objects.unlink(placed)
    empty = instancing(scene, unlinked("Placed", bpy.data.objects.new("First", None), placed))
    empty.location = (0.0, 0.0, 0.001)
    wrong, warnings = compared(cards, tmp_path)
    assert wrong == {}
    assert [text for text in warnings if "without a profile" not in text] == []


def said(scene):
    return any("attributes that nodes give their instances" in text for text in exported(scene)["warnings"])


@pytest.mark.skipif(bpy.app.version >= (4, 5, 0), reason="Python can read instances of nodes")
def test_what_nodes_give_is_said_where_python_cannot_read_it(scene):
    add_card(Cards(scene), "plain", plain("FLOAT"))
    assert said(scene)


def test_what_nodes_give_to_what_points_show_is_said(scene):
    """The way through points does not say which object it is."""
    card = add_card(Cards(scene), "shown", plain("FLOAT"))
    points = add(scene, "Points", bpy.data.meshes.new("Points"))
    points.data.from_pydata([(0, 0, 1)], [], [])
    card.parent, points.instance_type = points, "VERTS"
    assert said(scene)
