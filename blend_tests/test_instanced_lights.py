"""Lights that are instanced, in whichever way: the bake, the live picture and the rows have the same ones, and one row
drives all instances of its light."""

import json

import bpy
import numpy as np
import pytest

from addon.apply.writable import RefusedError
from addon.core.rows import GROUP, LIGHT
from addon.engine.shot import shot
from addon.live import rows
from addon.live.scheduler import scheduler
from addon.ui import mixer
from addon.ui.start import start
from helpers import add, add_quad, exported, render_cycles, row, said, settled, until, update
from instances import bulb, instancing, newest, particles, scatter, unlinked

pytestmark = pytest.mark.every_version

TWO = {"Bulb", "Bulb#2"}


def by_nodes(scene):
    scatter(scene.collection, bulb())


def by_nodes_of_a_collection(scene):
    scatter(scene.collection, unlinked("Source", bulb()))


def by_nodes_and_in_the_scene(scene):
    scatter(scene.collection, bulb(scene.collection))
    return {"Bulb", "Bulb#2", "Bulb#3"}


def by_nodes_though_hidden(scene):
    light = bulb(scene.collection)
    light.hide_render = light.hide_viewport = True
    scatter(scene.collection, light)


def by_nodes_though_excluded(scene):
    source = unlinked("Source", bulb())
    scene.collection.children.link(source)
    bpy.context.view_layer.layer_collection.children["Source"].exclude = True
    scatter(scene.collection, source)


def by_an_inner_group(scene):
    inner = scatter(unlinked("Aside"), bulb()).modifiers[0].node_group
    outer = bpy.data.node_groups.new("Outer", "GeometryNodeTree")
    outer.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    group, output = outer.nodes.new("GeometryNodeGroup"), outer.nodes.new("NodeGroupOutput")
    group.node_tree = inner
    outer.links.new(group.outputs[0], output.inputs[0])
    add(scene, "Outer", bpy.data.meshes.new("Outer")).modifiers.new("Outer", "NODES").node_group = outer


def by_an_input_of_the_modifier(scene):
    obj = scatter(scene.collection, bulb())
    tree = obj.modifiers[0].node_group
    info = next(node for node in tree.nodes if node.bl_idname == "GeometryNodeObjectInfo")
    light, info.inputs["Object"].default_value = info.inputs["Object"].default_value, None
    socket = tree.interface.new_socket("Light", in_out="INPUT", socket_type="NodeSocketObject").identifier
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs["Light"], info.inputs["Object"])
    if hasattr(obj.modifiers[0], "properties"):
        getattr(obj.modifiers[0].properties.inputs, socket).value = light
    else:
        obj.modifiers[0][socket] = light
    obj.update_tag()


def by_an_instance_of_nodes(scene):
    collection = unlinked("Source")
    scatter(collection, bulb())
    instancing(scene, collection)


def by_nodes_of_an_instance(scene):
    empty = bpy.data.objects.new("Inner", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", unlinked("Source", bulb())
    scatter(scene.collection, unlinked("Outer", empty))


def by_particles(scene):
    particles(scene, instance_object=bulb())


def by_particles_though_hidden(scene):
    light = bulb()
    light.hide_render = True
    particles(scene, instance_object=light)


def by_particles_of_a_collection(scene):
    particles(scene, instance_collection=unlinked("Source", bulb()))


def by_faces(scene):
    carrier = add_quad(scene, "Carrier", size=0.5)
    carrier.location.z, carrier.instance_type, carrier.show_instancer_for_render = 2.0, "FACES", False
    bulb(scene.collection).parent = carrier
    return {"Bulb"}


def by_faces_further_up(scene):
    carrier = add_quad(scene, "Carrier", size=0.5)
    carrier.location.z, carrier.instance_type = 2.0, "FACES"
    between = add(scene, "Between", None)
    between.parent, bulb(scene.collection).parent = carrier, between


def in_a_collection_though_hidden(scene):
    light = bulb()
    light.hide_render = True
    scatter(scene.collection, unlinked("Source", light))
    return set()


WAYS = [
    *(by_nodes, by_nodes_of_a_collection, by_nodes_and_in_the_scene, by_nodes_though_hidden, by_nodes_though_excluded),
    *(by_an_inner_group, by_an_input_of_the_modifier, by_an_instance_of_nodes, by_nodes_of_an_instance),
    *(by_particles, by_particles_though_hidden, by_particles_of_a_collection, by_faces, by_faces_further_up),
    in_a_collection_though_hidden,
]


@pytest.mark.parametrize("way", WAYS)
def test_bake_picture_and_rows_have_the_same_lights(scene, live, way):
    wanted = way(scene)
    wanted = TWO if wanted is None else wanted
    made = live()
    assert {light["name"] for light in exported(scene)["lights"]} == wanted
    assert set(newest(made)) == wanted
    found = row(scene, "Bulb")
    assert not wanted or not mixer.is_hidden(scene, found), "it can be switched off"
    found.exposure = 1.0
    assert all(made.requests[-1]["gains"][name] == [2.0] * 3 for name in wanted)
    found.on = False
    assert newest(made) == {}
    assert said(scene) == []


def test_an_instance_shines_on_what_its_instancer_shines_on_too(scene, live):
    light = bulb()
    empty = instancing(scene, unlinked("Source", light))
    light.visible_glossy = False
    made = live()
    empty.visible_diffuse = False
    update()
    (found,) = made.requests[-1]["lights"]
    diffuse = 1 if bpy.app.version < (4, 5, 0) else 0  # As of Cycles.
    assert (found["lobes"]["diffuse"], found["lobes"]["glossy"], found["lobes"]["transmission"]) == (diffuse, 0, 1)
    assert found["lobes"] == exported(scene)["lights"][0]["lobes"]


def test_what_nodes_show_is_listed_below_the_collection_of_the_nodes(scene, live):
    props = unlinked("Props")
    scene.collection.children.link(props)
    scatter(props, bulb())
    live()
    listed = sorted(rows.present_rows(scene), key=lambda row: row.order)
    assert [(row.kind, row.name, row.depth) for row in listed[:2]] == [(GROUP, "Props", 0), (LIGHT, "Bulb", 0)]
    row(scene, "Props", GROUP).multiplier = 3.0
    assert rows.mix(scene, TWO)["gains"] == {name: [3.0] * 3 for name in TWO}


def test_a_light_in_the_scene_stays_in_its_own_collections_alone(scene, live):
    props = unlinked("Props")
    scene.collection.children.link(props)
    scatter(props, bulb(scene.collection))
    live()
    assert GROUP not in {row.kind for row in rows.present_rows(scene)}


def test_edits_of_nodes_and_lights_are_followed(scene, live):
    light, made = bulb(), live()
    assert newest(made) == {}
    obj = scatter(scene.collection, light)
    update()
    assert set(newest(made)) == TWO and row(scene, "Bulb").present
    obj.location.y = 3.0
    update()
    assert {round(light["world_from_object"][1][3], 5) for light in newest(made).values()} == {3.0}
    light.data.energy = 7.0
    update()
    assert {light["energy"] for light in newest(made).values()} == {7.0}
    line = next(node for node in obj.modifiers[0].node_group.nodes if node.bl_idname == "GeometryNodeMeshLine")
    line.inputs["Count"].default_value = 3
    update()
    assert set(newest(made)) == {*TWO, "Bulb#3"}
    obj.hide_render = True
    update()
    assert newest(made) == {}


def test_instances_of_a_light_that_views_alone_hide_are_said(scene, live):
    light = bulb()
    light.hide_viewport = True
    scatter(scene.collection, unlinked("Source", light))
    made = live()
    assert newest(made) == {} and len(exported(scene)["lights"]) == 2
    assert "light 'Bulb' is hidden in the view only: off here, but on in renders" in shot.of(scene).notes


def test_the_row_is_applied_to_all_instances_but_cannot_hide_what_nodes_name(scene, live):
    light = bulb(scene.collection)
    light.hide_render = light.hide_viewport = True
    scatter(scene.collection, light)
    live()
    row(scene, "Bulb").on = False
    with pytest.raises(RefusedError, match="light 'Bulb' is off, and geometry nodes or particles show it"):
        mixer.apply_to_lights(scene)
    row(scene, "Bulb").on, row(scene, "Bulb").exposure = True, -1.0
    mixer.apply_to_lights(scene)
    assert light.data.energy == pytest.approx(50.0) and row(scene, "Bulb").exposure == 0.0


def test_what_nodes_only_read_can_be_hidden(scene, live):
    light = bulb(scene.collection)
    light.location.z = 2.0
    obj = scatter(scene.collection, light)
    tree = obj.modifiers[0].node_group
    tree.links.remove(next(link for link in tree.links if link.to_socket.name == "Instance"))
    made = live()
    assert set(newest(made)) == {"Bulb"}
    row(scene, "Bulb").on = False
    mixer.apply_to_lights(scene)
    assert light.hide_render and light.hide_viewport and newest(made) == {}
    assert mixer.is_hidden(scene, row(scene, "Bulb")), "a box would say that it is on"
    tree.links.new(tree.nodes["Object Info"].outputs["Geometry"], tree.nodes["Instance on Points"].inputs["Instance"])
    update()
    assert set(newest(made)) == TWO and not mixer.is_hidden(scene, row(scene, "Bulb"))
    bpy.ops.relume.show_light(light="Bulb")
    assert set(newest(made)) == {*TWO, "Bulb#3"}


@pytest.mark.parametrize("way", [by_nodes, by_nodes_though_hidden, by_faces])
def test_the_picture_is_that_of_cycles(studio, way):
    bpy.data.objects.remove(bpy.data.objects["Key"])
    studio.relume.samples = 64
    way(studio)
    update()
    start(studio)
    scheduler.read_lights(studio)
    found = until(studio, settled, "the picture")
    ours = found.frame.image[..., :3].mean()
    assert ours == pytest.approx(render_cycles(studio, samples=256).mean(), rel=0.03)
    assert {light["name"] for light in found.lights.descriptions} == set(json.loads(found.frame.summary)["makers"])
    row(studio, "Bulb").on = False
    scheduler.request_picture(studio)
    assert np.abs(until(studio, settled, "darkness").frame.image[..., :3]).max() == 0.0
