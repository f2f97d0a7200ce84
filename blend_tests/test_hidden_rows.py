"""The rows of lights that are hidden, however they are, say so, and show them again where they can."""

import bpy
import pytest

from addon.core.rows import GROUP
from addon.live import rows
from addon.ui import mixer
from helpers import add_quad, row, update
from instances import bulb, instancing, newest, particles, scatter, unlinked


def rig(scene):
    """A light in a collection of the scene."""
    found = unlinked("Rig")
    scene.collection.children.link(found)
    return bulb(found)


def layer():
    return bpy.context.view_layer.layer_collection.children["Rig"]


def by_the_key_h(scene):
    rig(scene).hide_set(True)


def in_views(scene):
    rig(scene).hide_viewport = True


def in_renders(scene):
    rig(scene).hide_render = True


def by_the_eye_of_its_collection(scene):
    rig(scene)
    layer().hide_viewport = True
    return "by collection 'Rig'"


def by_an_excluded_collection(scene):
    rig(scene)
    layer().exclude = True
    return "by collection 'Rig'"


def by_its_collection_in_renders(scene):
    rig(scene).users_collection[0].hide_render = True
    return "by collection 'Rig'"


def inside_of_an_instance(scene):
    outer, inner = unlinked("Rig"), unlinked("Lamps")
    outer.children.link(inner)
    bulb(inner)
    inner.hide_render = outer.hide_viewport = True
    instancing(scene, outer)
    return "by collection 'Lamps' and 'Rig'"


def by_an_instance_in_renders(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    instancing(scene, lamps)
    bpy.data.objects["Instance"].hide_render = True
    return "by object 'Instance'"


def by_an_instance_in_views(scene):
    by_an_instance_in_renders(scene)
    bpy.data.objects["Instance"].hide_render = False
    bpy.data.objects["Instance"].hide_set(True)
    return "by object 'Instance'"


def by_an_instance_within_another(scene):
    outer, inner = unlinked("Rig"), unlinked("Lamps")
    bulb(inner).hide_render = True
    instancing(scene, inner)
    bpy.data.objects["Instance"].hide_viewport = True
    scene.collection.objects.unlink(bpy.data.objects["Instance"])
    outer.objects.link(bpy.data.objects["Instance"])
    instancing(scene, outer)
    outer.hide_render = True
    return "by collection 'Rig' and by object 'Instance'"


def by_what_nodes_scatter(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    scatter(scene.collection, lamps).hide_render = True
    for _ in range(4):
        scatter(scene.collection, lamps).hide_viewport = True
    return "by object 'Scatter', 'Scatter.001', 'Scatter.002' and 2 more"


def by_the_collection_of_the_second_that_shows_it(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    for name in ("First", "Second"):
        props = unlinked(name)
        scene.collection.children.link(props)
        scatter(props, lamps)
        props.hide_render = True
    return "by collection 'First' and 'Second'"


def by_nodes_that_are_off_in_renders(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    owner = scatter(scene.collection, lamps)
    owner.modifiers.new("Mirror", "MIRROR").show_render = False
    owner.modifiers["Scatter"].show_render = False
    return "by a switched-off modifier of 'Scatter'"


def by_particles_that_are_off_in_views(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    lamps.hide_render = True
    particles(scene, instance_collection=lamps)
    bpy.data.objects["Meadow"].modifiers[0].show_viewport = False
    return "by collection 'Lamps' and by a switched-off modifier of 'Meadow'"


def by_nodes_that_show_nothing(scene):
    lamps = unlinked("Lamps")
    bulb(lamps)
    owner = scatter(scene.collection, lamps)
    owner.modifiers.new("Mirror", "MIRROR").show_render = False
    line = next(node for node in owner.modifiers[0].node_group.nodes if node.bl_idname == "GeometryNodeMeshLine")
    line.inputs["Count"].default_value = 0
    return "though nothing is switched off: what could show it has no instance of it"


def by_a_hidden_carrier(scene):
    carrier = add_quad(scene, "Carrier")
    carrier.instance_type, carrier.hide_render = "FACES", True
    bulb(scene.collection).parent = carrier
    return "by object 'Carrier'"


WAYS = [
    *(by_the_key_h, in_views, in_renders, by_the_eye_of_its_collection, by_an_excluded_collection),
    *(by_its_collection_in_renders, inside_of_an_instance, by_an_instance_in_renders, by_an_instance_in_views),
    *(by_an_instance_within_another, by_what_nodes_scatter, by_the_collection_of_the_second_that_shows_it),
    *(by_nodes_that_are_off_in_renders, by_particles_that_are_off_in_views, by_nodes_that_show_nothing),
    by_a_hidden_carrier,
]


@pytest.mark.parametrize("way", WAYS)
def test_a_light_that_is_hidden_has_no_box_that_is_on(scene, live, way):
    hiding = way(scene)
    made = live()
    assert newest(made) == {} and mixer.is_hidden(scene, row(scene, "Bulb"))
    groups = [found for found in rows.present_rows(scene) if found.kind == GROUP]
    assert not any(mixer.is_hidden(scene, found) for found in groups)
    said = mixer.show_light(bpy.context, "Bulb")
    update()
    assert said == (f"'Bulb' is still hidden, {hiding}" if hiding else None)
    assert mixer.is_hidden(scene, row(scene, "Bulb")) == bool(hiding)
    assert (set(newest(made)) == {"Bulb"}) == (not hiding)


def test_nothing_hides_a_light_that_one_of_two_shows(scene, live):
    lamps = unlinked("Lamps")
    light = bulb(lamps)
    light.hide_render = True
    instancing(scene, lamps)
    scatter(scene.collection, lamps).hide_render = True
    live()
    assert mixer.is_hidden(scene, row(scene, "Bulb"))
    assert mixer.show_light(bpy.context, "Bulb") is None
    update()
    assert not mixer.is_hidden(scene, row(scene, "Bulb"))


def test_a_light_that_is_gone_is_said(scene, live):
    live()
    assert mixer.show_light(bpy.context, "Bulb") == "'Bulb' is not in this scene any more"


def test_without_a_picture_the_row_tells_of_the_light_itself(scene, registered_for_all_files):
    light = bulb(scene.collection)
    update()
    assert not mixer.is_hidden(scene, row(scene, "Bulb"))
    light.hide_render = True
    update()
    assert mixer.is_hidden(scene, row(scene, "Bulb"))
