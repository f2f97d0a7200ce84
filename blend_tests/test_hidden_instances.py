"""Lights of instanced collections in which something is hidden: the live picture has those that renders have, and what
views alone hide is said."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.engine.shot import shot
from addon.engine.staleness import fingerprints
from addon.engine.staleness.tracker import StalenessTracker
from addon.export.instancers import Instancers
from addon.live.scheduler import scheduler
from addon.ui.start import start
from helpers import add_quad, exported, render_cycles, said, settled, until, update
from instances import bulb, instancing, newest, particles, scatter, unlinked

pytestmark = pytest.mark.every_version


def inside(parent, name="Inner", **hidden):
    """A collection in another one."""
    made = unlinked(name)
    parent.children.link(made)
    for flag, value in hidden.items():
        setattr(made, flag, value)
    return made


def empty(collection, instanced=None, **settings):
    """An empty in a collection, that instances another one."""
    made = bpy.data.objects.new("Empty", None)
    collection.objects.link(made)
    if instanced is not None:
        made.instance_type, made.instance_collection = "COLLECTION", instanced
    for name, value in settings.items():
        setattr(made, name, value)
    return made


def carrier(scene, collection):
    """A square in a collection of its own that instances its children on its face; one of them shines."""
    obj = add_quad(scene, "Carrier", size=0.5)
    scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    obj.instance_type, obj.location.z = "FACES", 2.0
    return obj


def in_a_collection(scene):
    rig = unlinked("Rig")
    bulb(inside(rig, hide_render=True))
    instancing(scene, rig)
    return 0


def in_the_instanced_collection_itself(scene):
    rig = unlinked("Rig")
    rig.hide_render = True
    bulb(rig)
    instancing(scene, rig)
    return 0


def in_a_collection_of_a_hidden_one(scene):
    rig = unlinked("Rig")
    bulb(inside(inside(rig, "Middle", hide_render=True)))
    instancing(scene, rig)
    return 0


def in_another_collection_too(scene):
    rig = unlinked("Rig")
    light = bulb(inside(rig, hide_render=True))
    inside(rig, "Other").objects.link(light)
    instancing(scene, rig)
    return 1


def in_the_scene_too(scene):
    rig = unlinked("Rig")
    scene.collection.objects.link(bulb(inside(rig, hide_render=True)))
    instancing(scene, rig)
    return 1


def by_one_of_two_inner_instances(scene):
    rig, lamp = unlinked("Rig"), unlinked("Lamp")
    bulb(lamp)
    empty(rig, lamp)
    empty(rig, lamp, hide_render=True)
    empty(inside(rig, hide_render=True), lamp)
    instancing(scene, rig)
    return 1


def behind_what_views_hide(scene):
    rig, lamp = unlinked("Rig"), unlinked("Lamp")
    empty(rig, hide_viewport=True)
    empty(inside(rig, "Unseen", hide_viewport=True))
    empty(lamp, hide_viewport=True)
    bulb(lamp)
    empty(rig, lamp, hide_render=True)
    empty(rig, lamp)
    instancing(scene, rig)
    return 1


def in_a_collection_that_nodes_show(scene):
    source = unlinked("Source")
    bulb(inside(source, hide_render=True))
    scatter(scene.collection, source)
    return 0


def in_a_collection_that_particles_show(scene):
    source = unlinked("Source")
    bulb(inside(source, hide_render=True))
    particles(scene, instance_collection=source)
    return 0


def by_nodes_in_a_collection(scene):
    rig = unlinked("Rig")
    scatter(inside(rig, hide_render=True), bulb())
    instancing(scene, rig)
    return 0


def by_hidden_nodes(scene):
    rig = unlinked("Rig")
    scatter(rig, bulb()).hide_render = True
    instancing(scene, rig)
    return 0


def by_faces_in_a_collection(scene):
    rig = unlinked("Rig")
    bulb(rig).parent = carrier(scene, inside(rig, hide_render=True))
    instancing(scene, rig)
    return 0


def by_faces_that_are_shown(scene):
    rig = unlinked("Rig")
    bulb(rig).parent = carrier(scene, rig)
    instancing(scene, rig)
    return 1


def on_faces_of_the_scene(scene):
    lamps = inside(scene.collection, "Lamps", hide_render=True)
    bulb(lamps).parent = carrier(scene, scene.collection)
    return 0


def two_inner_instances():
    """A collection with two instances of a lamp, of which renders show one, and things that views alone hide."""
    rig, lamp = unlinked("Rig"), unlinked("Lamp")
    empty(lamp, hide_viewport=True)
    bulb(lamp)
    empty(rig, hide_viewport=True)
    empty(rig, lamp, hide_render=True)
    empty(rig, lamp, location=(0.3, 0.0, 0.0))
    return rig


def by_inner_instances_that_nodes_show(scene):
    scatter(scene.collection, two_inner_instances())
    return 2


def by_inner_instances_that_nested_nodes_show(scene):
    middle = unlinked("Middle")
    scatter(middle, two_inner_instances())
    scatter(scene.collection, middle)
    return 4


def by_inner_instances_of_instances_within_nodes(scene):
    tree = scatter(scene.collection, two_inner_instances()).modifiers[0].node_group
    nodes = {node.bl_idname: node for node in tree.nodes}
    line, points = tree.nodes.new("GeometryNodeMeshLine"), tree.nodes.new("GeometryNodeInstanceOnPoints")
    line.inputs["Count"].default_value = 3
    tree.links.new(line.outputs[0], points.inputs["Points"])
    tree.links.new(nodes["GeometryNodeInstanceOnPoints"].outputs[0], points.inputs["Instance"])
    tree.links.new(points.outputs[0], nodes["NodeGroupOutput"].inputs[0])
    return 6


def by_an_object_that_nodes_show(scene):
    rig = two_inner_instances()
    scatter(scene.collection, empty(unlinked("Aside"), rig))
    return 2


def by_a_hidden_object_that_nodes_show(scene):
    rig = two_inner_instances()
    scatter(scene.collection, empty(unlinked("Aside"), rig, hide_render=True))
    return 0


def separate(obj):
    """Nodes that show each thing in a collection, instead of all of it."""
    tree = obj.modifiers[0].node_group
    info = next(node for node in tree.nodes if node.bl_idname == "GeometryNodeCollectionInfo")
    info.inputs["Separate Children"].default_value = True


def by_separate_collections_that_nodes_show(scene):
    outer = unlinked("Outer")
    outer.children.link(two_inner_instances())
    bulb(inside(outer, "Unseen", hide_render=True))
    separate(scatter(scene.collection, outer))
    return 2


def though_hidden_separately_by_nodes(scene):
    source = unlinked("Source")
    bulb(source).hide_render = True
    separate(scatter(scene.collection, source))
    return 2


def shows(collection, node, block):
    """An object 2 m above the ground whose nodes hand on what a node gives of a block."""
    obj = bpy.data.objects.new("Shows", bpy.data.meshes.new("Shows"))
    collection.objects.link(obj)
    obj.location.z = 2.0
    tree = bpy.data.node_groups.new("Shows", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    info = tree.nodes.new(f"GeometryNode{node}Info")
    info.inputs[node].default_value = block
    output = next(socket for socket in info.outputs if socket.type == "GEOMETRY")
    tree.links.new(output, tree.nodes.new("NodeGroupOutput").inputs[0])
    obj.modifiers.new("Shows", "NODES").node_group = tree
    return obj


def by_geometry_that_other_nodes_take_in(scene):
    inner = shows(unlinked("Aside"), "Collection", two_inner_instances())
    inner.hide_render = True
    shows(scene.collection, "Object", inner)
    return 1


def by_nodes_that_are_off_in_renders(scene):
    scatter(scene.collection, bulb()).modifiers[0].show_render = False
    return 0


def by_particles_that_are_off_in_renders(scene):
    particles(scene, instance_object=bulb())
    bpy.data.objects["Meadow"].modifiers[0].show_render = False
    return 0


def by_inner_instances_on_faces(scene):
    square = carrier(scene, scene.collection)
    square.data.transform(Matrix.Translation((0.2, 0.0, 0.0)))
    empty(scene.collection, two_inner_instances()).parent = square
    return 1


def by_a_hidden_instance_on_faces(scene):
    lamps = inside(scene.collection, "Lamps", hide_render=True)
    empty(lamps, two_inner_instances()).parent = carrier(scene, scene.collection)
    return 0


def by_a_hidden_child_of_faces_in_an_instance(scene):
    rig = unlinked("Rig")
    bulb(inside(rig, hide_render=True)).parent = carrier(scene, rig)
    instancing(scene, rig)
    return 0


def by_a_hidden_child_of_faces_that_nodes_show(scene):
    rig = unlinked("Rig")
    bulb(inside(rig, hide_render=True)).parent = carrier(scene, rig)
    scatter(scene.collection, rig)
    return 0


def by_a_child_of_faces_of_which_one_collection_is_hidden(scene):
    rig = unlinked("Rig")
    light = bulb(inside(rig, hide_render=True), inside(rig, "Other"))
    light.parent = carrier(scene, rig)
    instancing(scene, rig)
    return 1


WAYS = [
    *(in_a_collection, in_the_instanced_collection_itself, in_a_collection_of_a_hidden_one),
    *(in_another_collection_too, in_the_scene_too, by_one_of_two_inner_instances, behind_what_views_hide),
    *(in_a_collection_that_nodes_show, in_a_collection_that_particles_show, by_nodes_in_a_collection, by_hidden_nodes),
    *(by_faces_in_a_collection, by_faces_that_are_shown, on_faces_of_the_scene),
    *(by_inner_instances_that_nodes_show, by_inner_instances_that_nested_nodes_show),
    *(by_inner_instances_of_instances_within_nodes, by_an_object_that_nodes_show, by_a_hidden_object_that_nodes_show),
    by_geometry_that_other_nodes_take_in,
    *(by_nodes_that_are_off_in_renders, by_particles_that_are_off_in_renders),
    *(by_separate_collections_that_nodes_show, though_hidden_separately_by_nodes, by_inner_instances_on_faces),
    *(by_a_hidden_instance_on_faces, by_a_hidden_child_of_faces_in_an_instance),
    *(by_a_hidden_child_of_faces_that_nodes_show, by_a_child_of_faces_of_which_one_collection_is_hidden),
]


@pytest.mark.parametrize("way", WAYS)
def test_the_live_picture_has_the_lights_of_renders(scene, live, way):
    number = way(scene)
    made = live()
    rendered = [light["shape"]["center"] for light in exported(scene)["lights"]]
    ours = [[row[3] for row in light["world_from_object"][:3]] for light in newest(made).values()]
    assert len(rendered) == number
    assert np.array(sorted(ours)) == pytest.approx(np.array(sorted(rendered)), abs=1e-5)


@pytest.mark.parametrize("way", WAYS)
def test_renders_have_them(scene, way):
    """Cycles does what the other test compares with."""
    add_quad(scene)
    number = way(scene)
    assert (render_cycles(scene, samples=4).max() > 0.0) == (number > 0)


def test_of_ways_that_are_not_understood_it_is_enough_that_the_light_is_shown(scene):
    source = unlinked("Source")
    light = bulb(source)
    owner = scatter(scene.collection, source)
    assert Instancers().renders(owner, (7, 7, 7, 7), light, lambda _: True)
    light.hide_render = True
    assert not Instancers().renders(owner, (7, 7, 7, 7), light, lambda _: True)


def of_an_instance(scene):
    by_one_of_two_inner_instances(scene)
    bpy.data.objects["Instance"].location.z = 2.0


@pytest.mark.parametrize("way", [of_an_instance, by_inner_instances_that_nodes_show])
def test_the_picture_is_that_of_cycles(studio, way):
    bpy.data.objects.remove(bpy.data.objects["Key"])
    studio.relume.samples = 64
    way(studio)
    update()
    start(studio)
    scheduler.read_lights(studio)
    ours = until(studio, settled, "the picture").frame.image[..., :3].mean()
    assert ours == pytest.approx(render_cycles(studio, samples=256).mean(), rel=0.03)


def test_hiding_and_showing_is_followed(scene, live):
    rig, lamp = unlinked("Rig"), unlinked("Lamp")
    inner = inside(rig)
    bulb(lamp)
    instance = empty(inner, lamp)
    instancing(scene, rig)
    made = live()
    for block in (inner, rig, lamp, instance, bpy.data.objects["Bulb"]):
        block.hide_render = True
        update()
        assert not newest(made), block.name
        block.hide_render = False
        update()
        assert len(newest(made)) == 1, block.name


def test_nodes_that_are_switched_off_and_on_in_renders_are_followed(scene, live):
    modifier = scatter(scene.collection, bulb()).modifiers[0]
    made = live()
    for is_on in (True, False, True):
        modifier.show_render = is_on
        modifier.id_data.update_tag(refresh={"DATA"})  # As the button does.
        update()
        assert bool(newest(made)) == is_on


def by_the_key_h(owner):
    owner.hide_set(not owner.hide_get())


def in_views(owner):
    owner.hide_viewport = not owner.hide_viewport


def by_the_eye_of_the_collection(_owner):
    layer = bpy.context.view_layer.layer_collection.children["Props"]
    layer.hide_viewport = not layer.hide_viewport


def by_excluding_the_collection(_owner):
    layer = bpy.context.view_layer.layer_collection.children["Props"]
    layer.exclude = not layer.exclude


@pytest.mark.parametrize("first", ["shown", "hidden"])
@pytest.mark.parametrize("kind", ["collection", "nodes", "faces"])
@pytest.mark.parametrize("toggle", [by_the_key_h, in_views, by_the_eye_of_the_collection, by_excluding_the_collection])
def test_what_instances_a_light_is_hidden_and_shown(scene, live, toggle, kind, first):
    props = inside(scene.collection, "Props")
    if kind == "faces":
        owner = carrier(scene, props)
        bulb(scene.collection).parent = owner
    else:
        lamp = unlinked("Lamp")
        bulb(lamp)
        owner = empty(props, lamp) if kind == "collection" else scatter(props, lamp)
    update()
    if first == "hidden":
        toggle(owner)
    made = live()
    for is_shown in (True, False, True) if first == "shown" else (False, True, False):
        assert bool(newest(made)) == is_shown
        said = shot.of(scene).notes == ["light 'Bulb' is hidden in the view only: off here, but on in renders"]
        is_in_renders = len(exported(scene)["lights"]) > 0
        assert said == (not is_shown and is_in_renders and kind != "faces"), shot.of(scene).notes
        toggle(owner)
        update()


@pytest.mark.parametrize("hidden", ["Inner", "Bulb", "Empty"])
def test_what_views_alone_hide_is_said(scene, live, hidden):
    rig, lamp = unlinked("Rig"), unlinked("Lamp")
    bulb(inside(lamp))
    empty(rig, lamp)
    instancing(scene, rig)
    (bpy.data.collections if hidden == "Inner" else bpy.data.objects)[hidden].hide_viewport = True
    made = live()
    assert not newest(made) and len(exported(scene)["lights"]) == 1
    assert "light 'Bulb' is hidden in the view only: off here, but on in renders" in shot.of(scene).notes


def test_objects_that_instanced_collections_hide_are_noticed(scene, live):
    rig = unlinked("Rig")
    inner, lamps = inside(rig), inside(rig, "Lamps")
    bulb(lamps)
    sofa = add_quad(scene, "Sofa")
    scene.collection.objects.unlink(sofa)
    inner.objects.link(sofa)
    instancing(scene, rig)
    live().tell(state="ready", samples=4, samples_total=4)
    assert said(scene) == []
    lamps.hide_render = True
    assert said(scene) == [], "lights are in no bake"
    inner.hide_render = True
    assert said(scene) == ["Objects were hidden or shown by their collection"]
    inner.hide_render = False
    assert said(scene) == []


def by_nodes_of_a_modifier(scene, collection):
    scatter(scene.collection, collection)


def by_particles(scene, collection):
    particles(scene, instance_collection=collection)


def by_an_instance_that_nodes_show(scene, collection):
    outer = unlinked("Outer")
    empty(outer, collection)
    scatter(scene.collection, outer)


@pytest.mark.parametrize("way", [by_nodes_of_a_modifier, by_particles, by_an_instance_that_nodes_show])
def test_what_nodes_and_particles_instance_is_noticed_when_hidden(scene, live, way):
    rig = unlinked("Rig")
    inner, lamps = inside(rig), inside(rig, "Lamps")
    light = bulb(lamps)
    sofa = add_quad(scene, "Sofa")
    scene.collection.objects.unlink(sofa)
    inner.objects.link(sofa)
    way(scene, rig)
    live()
    # Without a window the start of a bake evaluates particles anew, which Blender calls an edit.
    shot.of(scene).changes = StalenessTracker(fingerprints.all_fingerprints(scene, scene.camera))
    assert said(scene) == []
    lamps.hide_render = light.hide_render = True
    assert said(scene) == [], "lights are in no bake"
    for block, name in ((inner, "Inner"), (rig, "Rig"), (sofa, "Inner")):
        block.hide_render = True
        assert said(scene) == [f"Objects of collection '{name}' were hidden or shown"]
        block.hide_render = False
        assert said(scene) == []
    sofa.data.vertices[0].co.z = 0.25
    sofa.data.update()
    assert said(scene) == ["Geometry 'Sofa' changed"]


def test_a_collection_that_cuts_cuts_hidden_too(scene, live):
    cutters = unlinked("Cutters", add_quad(scene, "Cutter"))
    scene.collection.objects.unlink(bpy.data.objects["Cutter"])
    cut = add_quad(scene, "Cut").modifiers.new("Cut", "BOOLEAN")
    cut.operand_type, cut.collection = "COLLECTION", cutters
    live().tell(state="ready", samples=4, samples_total=4)
    assert said(scene) == []
    cutters.hide_render = True
    assert said(scene) == []
