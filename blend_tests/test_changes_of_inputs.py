"""Inputs of geometry, which no render shows themselves, are noticed where they change after the bake."""

import bpy
import pytest

from addon.core.diff import LATER
from addon.engine.shot import shot
from addon.engine.staleness import fingerprints
from addon.engine.staleness.tracker import StalenessTracker
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_material, add_quad, said, update


def hidden(obj):
    """Leaves an object out of renders; the object."""
    obj.hide_render = True
    return obj


def add_hidden(scene, name, data=None):
    return hidden(add(scene, name, data))


def modifier(obj, kind, **settings):
    made = obj.modifiers.new(kind.title(), kind)
    for name, value in settings.items():
        setattr(made, name, value)
    return made


def add_curve(name):
    curve = bpy.data.curves.new(name, "CURVE")
    curve.dimensions, curve.bevel_depth = "3D", 0.1
    curve.splines.new("BEZIER").bezier_points.add(1)
    for point, x in zip(curve.splines[0].bezier_points, (-1.0, 1.0), strict=True):
        point.handle_left_type = point.handle_right_type = "FREE"
        point.co, point.handle_left, point.handle_right = (x, 0, 0), (x - 0.5, 0, 0), (x + 0.5, 0, 0)
    return curve


def add_group(name, *inputs):
    """A group of geometry nodes that hands its geometry on."""
    group = bpy.data.node_groups.new(name, "GeometryNodeTree")
    for socket, kind in (("Geometry", "Geometry"), *inputs):
        group.interface.new_socket(socket, in_out="INPUT", socket_type=f"NodeSocket{kind}")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    first, last = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    group.links.new(first.outputs["Geometry"], last.inputs["Geometry"])
    return group


def add_nodes(scene, obj):
    """Geometry nodes with a group in a group, that read an object, a collection and a material no render shows."""
    outer, inner = add_group("Outer", ("Height", "Float"), ("Guide", "Object")), add_group("Inner")
    inner.nodes.new("GeometryNodeSetPosition")
    outer.nodes.new("GeometryNodeGroup").node_tree = inner
    outer.nodes.new("GeometryNodeSetMaterial").inputs["Material"].default_value = add_material("Painted")[0]
    props = bpy.data.collections.new("Props")
    props.objects.link(add_quad(scene, "Prop"))
    scene.collection.objects.unlink(bpy.data.objects["Prop"])
    outer.nodes.new("GeometryNodeObjectInfo").inputs["Object"].default_value = hidden(add_quad(scene, "Stamp"))
    outer.nodes.new("GeometryNodeCollectionInfo").inputs["Collection"].default_value = props
    made = modifier(obj, "NODES", node_group=outer)
    put(made, "Guide", add_hidden(scene, "Guide"))


def put(made, name, value):
    """Sets an input of a geometry nodes modifier."""
    socket = next(item for item in made.node_group.interface.items_tree if item.name == name)
    if bpy.app.version < (5, 2, 0):
        made[socket.identifier] = value
    else:
        getattr(made.properties.inputs, socket.identifier).value = value


def add_shape_key(obj):
    obj.shape_key_add(name="Basis")
    obj.shape_key_add(name="Bent").value = 1.0


def add_rig(scene):
    """An armature of one bone."""
    rig = add_hidden(scene, "Rig", bpy.data.armatures.new("Rig"))
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones.new("Bone").tail = (0.0, 0.0, 1.0)
    bpy.ops.object.mode_set(mode="OBJECT")
    return rig


@pytest.fixture
def baked(lit):
    """A bake of objects whose modifiers read others."""
    scene, sofa = lit, add_quad(lit, "Sofa")
    modifier(sofa, "BOOLEAN", object=hidden(add_quad(scene, "Cutter")))
    bpy.data.objects["Cutter"].hide_viewport = True
    modifier(sofa, "MIRROR", mirror_object=add_hidden(scene, "Middle"))
    modifier(sofa, "HOOK", object=add_hidden(scene, "Handle"), falloff_type="CURVE")
    modifier(sofa, "LATTICE", object=add_hidden(scene, "Cage", bpy.data.lattices.new("Cage")))
    modifier(sofa, "CURVE", object=add_hidden(scene, "Rail", add_curve("Rail")))
    modifier(sofa, "SHRINKWRAP", target=hidden(add_quad(scene, "Ground")))
    modifier(sofa, "DATA_TRANSFER", object=hidden(add_quad(scene, "Source")))
    modifier(sofa, "DISPLACE", texture=bpy.data.textures.new("Waves", "CLOUDS"))
    modifier(sofa, "ARMATURE", object=add_rig(scene))
    modifier(sofa, "UV_PROJECT", projector_count=1).projectors[0].object = add_hidden(scene, "Projector")
    modifier(sofa, "WARP", object_from=add_hidden(scene, "Off"), show_render=False)
    sofa.vertex_groups.new(name="Soft").add([0, 1], 1.0, "REPLACE")
    add_shape_key(sofa)
    add_nodes(scene, add_quad(scene, "Lawn"))
    cable = add(scene, "Cable", add_curve("Cable"))
    cable.data.bevel_mode, cable.data.bevel_object = "OBJECT", add_hidden(scene, "Profile", add_curve("Profile"))
    add_shape_key(add(scene, "Wire", add_curve("Wire")))
    add(scene, "Blob", bpy.data.metaballs.new("Blob")).data.elements.new()
    add_quad(scene, "Follower").constraints.new("COPY_LOCATION").target = add_hidden(scene, "Leader")
    update()
    start(scene)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(scene) == []
    return scene


def move(name):
    def moved():
        bpy.data.objects[name].location.z += 0.25
        return f"'{name}' moved"

    return moved


def bend(name):
    def bent():
        mesh = bpy.data.meshes[name]
        mesh.vertices[0].co.z = 0.25
        mesh.update()
        return f"Geometry '{name}' changed"

    return bent


def bend_lattice():
    bpy.data.lattices["Cage"].points[0].co_deform.x += 0.1
    return "Geometry 'Cage' changed"


def curve_part(name, part, value):
    def changed():
        setattr(bpy.data.curves[name].splines[0].bezier_points[0], part, value)
        return f"Geometry '{name}' changed"

    return changed


def element_part(part, value):
    def changed():
        setattr(bpy.data.metaballs["Blob"].elements[0], part, value)
        return "Geometry 'Blob' changed"

    return changed


def key_point():
    keys = bpy.data.meshes["Sofa"].shape_keys
    keys.key_blocks["Bent"].data[0].co.z = 0.5
    keys.update_tag()
    return "Geometry 'Sofa' changed"


def key_handle():
    keys = bpy.data.curves["Wire"].shape_keys
    keys.key_blocks["Bent"].data[0].handle_left.z = 0.5
    keys.update_tag()
    return "Geometry 'Wire' changed"


def weight():
    sofa = bpy.data.objects["Sofa"]
    sofa.vertex_groups["Soft"].add([1], 0.5, "REPLACE")
    sofa.data.update_tag()
    return "Geometry 'Sofa' changed"


def falloff():
    curve = bpy.data.objects["Sofa"].modifiers["Hook"].falloff_curve.curves[0]
    curve.points[0].location.y = 0.5
    bpy.data.objects["Sofa"].update_tag()
    return "Modifiers of 'Sofa' changed"


def other_projector():
    bpy.data.objects["Sofa"].modifiers["Uv_Project"].projectors[0].object = bpy.data.objects["Middle"]
    bpy.data.objects["Sofa"].update_tag()
    return "Modifiers of 'Sofa' changed"


def pose():
    bpy.data.objects["Rig"].pose.bones["Bone"].location.x = 0.5
    return "'Rig' has another pose"


def texture():
    bpy.data.textures["Waves"].noise_scale = 0.5
    return "Texture 'Waves' changed"


def texture_ramp():
    waves = bpy.data.textures["Waves"]
    waves.use_color_ramp = True
    waves.color_ramp.elements[0].color = (1.0, 0.0, 0.0, 1.0)
    return "Texture 'Waves' changed"


def node_of(group, kind):
    return next(node for node in bpy.data.node_groups[group].nodes if node.bl_idname == f"GeometryNode{kind}")


def outer_group():
    node_of("Outer", "ObjectInfo").inputs["As Instance"].default_value = True
    return "Node group 'Outer' changed"


def inner_group():
    node_of("Inner", "SetPosition").inputs["Offset"].default_value = (0.0, 0.0, 1.0)
    return "Node group 'Inner' changed"


def inner_link():
    tree = bpy.data.node_groups["Inner"]
    tree.links.remove(tree.links[0])
    return "Node group 'Inner' changed"


def node_input():
    lawn = bpy.data.objects["Lawn"]
    put(lawn.modifiers["Nodes"], "Height", 2.0)
    lawn.update_tag()
    return "Modifiers of 'Lawn' changed"


def painted():
    tree = bpy.data.materials["Painted"].node_tree
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return "Material 'Painted' changed"


def other_terminator():
    sofa = bpy.data.objects["Sofa"]
    owner = sofa if hasattr(sofa, "shadow_terminator_shading_offset") else sofa.cycles
    setattr(owner, "shadow_terminator_shading_offset" if owner is sofa else "shadow_terminator_offset", 0.5)
    sofa.update_tag()  # Properties of add-ons are tagged by the window alone.
    return "Colour, pass index or shadow terminator of 'Sofa' changed"


def other_objects():
    bpy.data.collections["Props"].objects.link(bpy.data.objects["Middle"])
    return "Collection 'Props' has other objects"


def grass():
    bpy.data.particles["Grass"].count = 10
    return "Particle settings 'Grass' changed"


def seed():
    bpy.data.objects["Lawn"].particle_systems[0].seed = 3
    return "Modifiers of 'Lawn' changed"


def lead():
    bpy.data.objects["Leader"].location.x = 1.0
    return "'Follower' moved"


MOVED = ["Cutter", "Middle", "Handle", "Cage", "Rail", "Ground", "Source", "Projector"]
NAMED = [
    *(bend_lattice, key_point, key_handle, weight, falloff, other_projector, pose, texture, texture_ramp),
    *(outer_group, inner_group, inner_link, node_input, painted, other_terminator, other_objects, lead),
]
CHANGES = {
    **{f"move {name}": move(name) for name in [*MOVED, "Rig", "Stamp", "Prop", "Guide", "Profile"]},
    **{f"bend {name}": bend(name) for name in ["Cutter", "Ground", "Source", "Stamp", "Prop"]},
    **{
        f"{part} of {name}": curve_part(name, part, value)
        for name in ("Cable", "Rail", "Profile")
        for part, value in {"handle_left": (-1.5, 0.5, 0.0), "radius": 2.0, "tilt": 1.0, "co": (-1, 1, 0)}.items()
    },
    "radius": element_part("radius", 3.0),
    "stiffness": element_part("stiffness", 1.0),
    **{of.__name__: of for of in NAMED},
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_every_change_is_named_and_undone(baked, change):
    bpy.ops.ed.undo_push(message="before")
    sentence = change()
    assert said(baked) == [sentence]
    bpy.ops.ed.undo_push(message="changed")
    bpy.ops.ed.undo()
    assert said(bpy.context.scene) == []


def grow():
    bpy.data.particles["Grass"].count = 10
    return "Particle settings 'Grass' changed"


def other_seed():
    bpy.data.objects["Lawn"].particle_systems[0].seed = 3
    return "Modifiers of 'Lawn' changed"


@pytest.mark.parametrize("change", [grow, other_seed, move("Blade"), bend("Blade")])
def test_particles_and_what_they_show_are_named(lit, change):
    lawn = add_quad(lit, "Lawn")
    modifier(lawn, "PARTICLE_SYSTEM")
    grass = lawn.particle_systems[0].settings
    grass.name, grass.render_type, grass.instance_object = "Grass", "OBJECT", hidden(add_quad(lit, "Blade"))
    update()
    start(lit)
    # Without a window the start of a bake evaluates particles anew, which Blender calls an edit.
    shot.of(lit).changes = StalenessTracker(fingerprints.all_fingerprints(lit, lit.camera))
    assert said(lit) == []
    sentence = change()
    assert said(lit) == [sentence]


def test_what_no_modifier_reads_is_no_change(baked):
    for name in ("Off", "Leader"):
        bpy.data.objects[name].rotation_euler.z = 1.0
    bpy.data.objects["Cutter"].hide_viewport = False
    tree = bpy.data.node_groups["Inner"]
    shown = tree.nodes.new("GeometryNodeViewer").inputs[0]
    tree.links.new(node_of("Inner", "SetPosition").outputs["Geometry"], shown)
    tree.nodes["Group Input"].location.x = -200.0
    tree.nodes["Group Output"].select = True
    bpy.data.objects["Rail"].select_set(True)
    bpy.data.objects["Key"].location.x = 2.0
    assert said(baked) == []


def test_what_is_edited_while_the_bake_begins_is_named(lit):
    modifier(add_quad(lit, "Sofa"), "BOOLEAN", object=hidden(add_quad(lit, "Cutter")))
    update()
    start(lit)
    bpy.data.objects["Cutter"].location.x = 0.5
    bpy.data.objects["Key"].location.x = 0.5
    edited = "was edited while the bake began"
    assert said(lit) == [f"'Sofa' {edited}", f"'Cutter' {edited}"]
    bpy.data.objects["Key"].location.x = 1.0
    assert said(lit) == [f"'Sofa' {edited}", f"'Cutter' {edited}"]


def test_a_modifier_that_gets_its_target_back_is_as_baked(baked):
    mirror = bpy.data.objects["Sofa"].modifiers["Mirror"]
    mirror.mirror_object = None
    assert said(baked) == ["Modifiers of 'Sofa' changed"]
    mirror.mirror_object = bpy.data.objects["Middle"]
    assert said(baked) == []
    move("Middle")()
    assert said(baked) == ["'Middle' moved"]


def test_bakes_from_before_say_nothing_of_what_they_did_not_note(baked):
    found = shot.of(baked).changes
    older = {"camera", "film", "settings", "collections", "world", "object", "data", "material", "image"}
    found.baked = {
        key: {part: text for part, text in taken.items() if part not in LATER}
        for key, taken in found.baked.items()
        if key.partition(" ")[0] in older
    }
    found.mark_all()
    assert said(baked) == []
    move("Cutter")()
    curve_part("Cable", "tilt", 1.0)()
    assert said(baked) == []
    curve_part("Cable", "co", (0, 0, 1))()
    assert said(baked) == ["Geometry 'Cable' changed"]


def test_a_large_group_is_looked_at_node_by_node(baked):
    tree = bpy.data.node_groups["Inner"]
    for _ in range(50):
        tree.nodes.new("GeometryNodeSetPosition")
    steps = fingerprints.fingerprint(baked, "nodes Inner")
    for _ in range(20):
        next(steps)
    tree.nodes.clear()
    assert len(list(steps)) > 20
    walk = fingerprints.iter_fingerprints(baked)
    assert {"nodes Inner", "nodes Outer", "helper Stamp", "material Painted"} <= {key for key, _ in walk}


def test_a_walk_through_a_group_holds_nothing_that_an_edit_frees(baked):
    tree = bpy.data.node_groups["Outer"]
    for _ in range(50):
        tree.nodes.new("GeometryNodeSetPosition")
    walk = fingerprints.iter_fingerprints(baked)
    next(key for key, _ in walk if key == "nodes Outer")
    next(walk)
    tree.nodes.clear()
    assert "data Lawn" in {key for key, _ in walk}


@pytest.mark.parametrize("steps_before", range(12))
def test_a_shape_may_lose_its_parts_while_it_is_looked_at(baked, steps_before):
    sofa, cable = bpy.data.objects["Sofa"], bpy.data.objects["Cable"]
    taken = [fingerprints.fingerprint(baked, key) for key in ("data Sofa", "data Cable", "data Cage")]
    for _ in range(steps_before):
        for steps in taken:
            next(steps, None)
    sofa.shape_key_clear()
    sofa.data.clear_geometry()
    cable.data.splines.clear()
    bpy.data.lattices["Cage"].points_u = 1
    for steps in taken:
        assert len(list(steps)) < 100


@pytest.mark.parametrize(("mark", "names"), [("<UDIM>", ("1001", "1012")), ("<UVTILE>", ("u1_v1", "u2_v2"))])
def test_the_file_of_every_tile_counts(scene, tmp_path, mark, names):
    for name in names:
        (tmp_path / f"a.{name}.png").write_bytes(b"before")
    image = bpy.data.images.load(str(tmp_path / f"a.{names[0]}.png"))
    image.source, image.filepath = "TILED", str(tmp_path / f"a.{mark}.png")
    image.tiles.new(1012)
    found = fingerprints._image(image)
    for name in names:
        (tmp_path / f"a.{name}.png").write_bytes(b"after")
        assert fingerprints._image(image) != found
        found = fingerprints._image(image)
