"""Components of objects besides their own geometry, of geometry nodes and hair: all are drawn or named."""

import bpy
import pytest

from helpers import add, add_quad, exported
from instances import unlinked

pytestmark = pytest.mark.every_version

COMPONENTS = {
    "curves": "GeometryNodeCurvePrimitiveCircle",
    "point clouds": "GeometryNodePoints",
}
MESH = "GeometryNodeMeshCube"


def add_components(obj, *kinds, as_instances=False):
    """Nodes that put something beside an object's own geometry."""
    tree = bpy.data.node_groups.new("Components", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    own, join, output = (
        tree.nodes.new(f"{kind}") for kind in ("NodeGroupInput", "GeometryNodeJoinGeometry", "NodeGroupOutput")
    )
    tree.links.new(own.outputs[0], join.inputs[0])
    for kind in kinds:
        made = tree.nodes.new(kind).outputs[0]
        if as_instances:
            instance = tree.nodes.new("GeometryNodeGeometryToInstance")
            tree.links.new(made, instance.inputs[0])
            made = instance.outputs[0]
        tree.links.new(made, join.inputs[0])
    tree.links.new(join.outputs[0], output.inputs[0])
    obj.modifiers.new("Components", "NODES").node_group = tree
    return obj


def add_curve(scene, name="Curve"):
    """A curve without a profile, which renders do not show."""
    data = bpy.data.curves.new(name, "CURVE")
    data.splines.new("POLY").points.add(1)
    return add(scene, name, data)


@pytest.mark.parametrize("as_instances", [False, True])
def test_each_component_beside_a_mesh_is_named(scene, as_instances):
    add_components(add_quad(scene), *COMPONENTS.values(), as_instances=as_instances)
    found = exported(scene)
    assert [instance["name"] for instance in found["instances"]] == ["Plane", "Plane"]
    assert [points["points"] for points in found["points"]] == [1]
    assert sorted(found["warnings"]) == [
        "object 'Plane': curves that its geometry nodes leave without a profile are left out, as by Cycles",
    ]


def test_components_in_an_instanced_collection_are_named_once(scene):
    wiry = add_components(add_quad(scene, "Wiry"), COMPONENTS["curves"])
    scene.collection.objects.unlink(wiry)
    rig = unlinked("Rig", wiry)
    for name in ("First", "Second"):
        empty = add(scene, name, None)
        empty.instance_type, empty.instance_collection = "COLLECTION", rig
    found = exported(scene)
    assert len(found["instances"]) == 2
    assert found["warnings"] == [
        "object 'Wiry': curves that its geometry nodes leave without a profile are left out, as by Cycles"
    ]


def test_a_curve_object_shows_what_its_nodes_instance(scene):
    add_components(add_curve(scene), MESH, COMPONENTS["point clouds"], as_instances=True)
    found = exported(scene)
    assert [instance["name"] for instance in found["instances"]] == ["Curve", "Curve"]
    assert sorted(next(iter(instance["geometry"])) for instance in found["instances"]) == ["mesh", "points"]


def test_hair_is_exported_where_renders_show_it(scene):
    def meadow(name, **settings):
        obj = add_quad(scene, name)
        modifier = obj.modifiers.new("Grass", "PARTICLE_SYSTEM")
        modifier.particle_system.settings.count = 3
        for key, value in settings.items():
            setattr(modifier.particle_system.settings, key, value)
        return obj, modifier

    meadow("Meadow", type="HAIR")
    meadow("Bald", type="HAIR", count=0)
    meadow("Guides", type="HAIR", render_type="NONE")
    meadow("Sparks", type="EMITTER", render_type="HALO")
    meadow("Mown", type="HAIR")[1].show_render = False
    meadow("Only hair", type="HAIR")[0].show_instancer_for_render = False
    found = exported(scene)
    haired = [instance["name"] for instance in found["instances"] if "curves" in instance["geometry"]]
    assert haired == ["Meadow", "Only hair"]
    assert [hair["curves"] for hair in found["curves"]] == [3, 3] and not found["warnings"]
