"""No shader node of Blender is left without a decision, and decisions are about what there is."""

import bpy
import pytest
from blender_lists import shader_nodes
from nodes_table import EQUAL, NODES, NOT, OPTIONS, SOCKETS, decision

from addon.export.materials.exporter import TABLES
from addon.export.materials.values import VECTOR_OPERATIONS
from helpers import add_material, add_quad, exported

pytestmark = pytest.mark.every_version


@pytest.fixture
def nodes():
    return shader_nodes()


def test_each_shader_node_is_decided(nodes):
    undecided = [node for node in nodes if decision(node) is None]
    assert not undecided, f"decide in nodes_table.py what becomes of {undecided}"


def test_exceptions_are_about_items_and_sockets_that_there_are(nodes):
    wrong = [key for key in SOCKETS if key[0] in nodes and key[0] not in NODES and decision(key[0]) is None]
    for kind, prop, item in OPTIONS:
        if kind in nodes and prop not in nodes[kind]["options"]:
            wrong.append((kind, prop, item))
    assert wrong == []


def test_every_operation_on_vectors_is_translated_or_an_exception(nodes):
    items = set(nodes["ShaderNodeVectorMath"]["options"]["operation"])
    assert items - VECTOR_OPERATIONS == {item for kind, _, item in OPTIONS if kind == "ShaderNodeVectorMath"} & items


def test_nodes_that_are_not_there_are_named(scene, nodes):
    """A node whose output counts is translated by the exporter, or named."""
    add_quad(scene, "Nothing")
    missing = [kind for kind in nodes if decision(kind)[0] == NOT and kind not in TABLES.closures]
    for kind in missing:
        material, tree, output = add_material(kind)
        node = tree.nodes.new(kind)
        if not node.outputs or node.outputs[0].type == "STRING":
            continue
        socket = node.outputs[0]
        if socket.type == "SHADER":
            tree.links.new(socket, output.inputs["Surface"])
        else:
            emission = tree.nodes.new("ShaderNodeEmission")
            tree.links.new(socket, emission.inputs["Color"])
            tree.links.new(emission.outputs[0], output.inputs["Surface"])
        add_quad(scene, kind, material=material)
    said = " ".join(exported(scene)["warnings"])
    unsaid = [kind for kind in missing if bpy.data.materials[kind].users and f"material '{kind}'" not in said]
    assert unsaid == [] or unsaid == ["ShaderNodeScript"]  # Without a script it has no outputs.


def test_decided_nodes_are_not_in_two_places(nodes):
    twice = [kind for kind in NODES if kind in TABLES.values and NODES[kind][0] == EQUAL]
    assert twice == []
