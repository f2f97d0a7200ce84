"""Changes of a scene since its bake are noticed, in words, and outlive saving and opening."""

import json
import time

import bpy
import numpy as np
import pytest

from addon.engine.shot import record, shot
from addon.engine.staleness import fingerprints
from addon.engine.staleness.tracker import StalenessTracker
from addon.engine.world import worlds
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_material, add_quad, background, said


@pytest.fixture
def baked(lit):
    """A bake of a lit plane and a red cube, with a world; what the add-on says has changed."""
    lit.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 2, 0):
        lit.world.use_nodes = True
    background(lit).inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    material, tree, output = add_material("Red")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(lit, "Sofa", material=material)
    furniture, assets = (bpy.data.collections.new(name) for name in ("Furniture", "Assets"))
    lit.collection.children.link(furniture)
    for name, collection in (("Chair", furniture), ("Leaf", assets)):
        made = add_quad(lit, name)
        collection.objects.link(made)
        lit.collection.objects.unlink(made)
    plant = bpy.data.objects.new("Plant", None)
    plant.instance_type, plant.instance_collection = "COLLECTION", assets
    lit.collection.objects.link(plant)
    bpy.ops.ed.undo_push(message="set up")
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(lit) == []
    return lit


def test_edits_of_many_are_noted_without_looking_for_each(lit, monkeypatch):
    for number in range(100):
        add_quad(lit, f"Quad {number}")
    lit.view_layers[0].update()
    names, scanned = [], StalenessTracker(None)
    monkeypatch.setattr(fingerprints, "_by_full_name", lambda _place, name: names.append(name))

    def marked(scene, depsgraph):
        scanned.mark(scene, list(depsgraph.updates))

    bpy.app.handlers.depsgraph_update_post.append(marked)
    for obj in lit.objects:
        obj.location.x += 1.0
    lit.view_layers[0].update()
    bpy.app.handlers.depsgraph_update_post.remove(marked)
    assert names == [] and {f"object Quad {number}" for number in range(100)} <= scanned.baked.keys()


def test_undo_is_looked_at_in_every_scene(baked, tmp_path):
    other = baked.copy()
    other.relume.folder = str(tmp_path / "other")
    start(other)
    bpy.ops.ed.undo_push(message="before")
    bpy.data.objects["Sofa"].location.x = 2.0
    bpy.ops.ed.undo_push(message="moved")
    while any(found.changes.is_pending for found in shot.all_open()):
        scheduler.tick()
        scheduler.settling.clear()
    bpy.ops.ed.undo()
    assert all(found.changes.is_pending for found in shot.all_open()) and len(shot.all_open()) == 2


def test_kinds_of_a_newer_relume_are_left_out(tmp_path):
    content = {"format": record.FORMAT, "version": record.VERSION, "camera": "C", "receivers": []}
    text = json.dumps(content | {"prints": {"splat Fog": {"cloud": "1"}, "film": {"size": "4 x 4"}}})
    (tmp_path / record.FILE).write_text(text)
    assert record.read(tmp_path).fingerprints == {"film": {"size": "4 x 4"}}


def test_a_deleted_scene_keeps_nothing_awake(baked):
    other = baked.copy()
    scheduler.settling[other.session_uid] = time.monotonic() + 60.0
    bpy.data.scenes.remove(other)
    scheduler.tick()
    assert not scheduler.settling


def test_meshes_are_walked_last(baked):
    kinds = [key.partition(" ")[0] for key, _ in fingerprints.iter_fingerprints(baked) if key]
    assert kinds.index("data") > max(place for place, kind in enumerate(kinds) if kind != "data")


def test_a_material_that_is_edited_while_the_bake_begins_is_named(lit):
    material, tree, output = add_material("Red")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(lit, "Sofa", material=material)
    bpy.context.view_layer.update()
    start(lit)
    diffuse.inputs["Roughness"].default_value = 0.5
    assert said(lit) == ["'Red' was edited while the bake began"]


def test_a_walk_holds_nothing_that_an_edit_frees(scene):
    material, tree, _ = add_material("Both")
    images = [bpy.data.images.new(name, 4, 4) for name in ("One", "Two")]
    for image in images:
        tree.nodes.new("ShaderNodeTexImage").image = image
    plane = add_quad(scene, material=material)
    plane.data.materials.append(add_material("Other")[0])
    walk = fingerprints.iter_fingerprints(scene)
    keys = [next(walk)[0]]
    while not keys[-1].startswith("image "):
        keys.append(next(walk)[0])
    tree.nodes.clear()
    plane.data.materials.clear()
    keys += [key for key, _ in walk]
    assert {"image One", "image Two", "material Other"} <= set(keys)
    walk = fingerprints.iter_fingerprints(scene)
    next(key for key, _ in walk if key.startswith("object "))
    bpy.data.objects.remove(plane)
    with pytest.raises(ReferenceError):
        list(walk)


def move_camera(scene):
    scene.camera.location.x = 1.0
    return "The camera moved"


def other_lens(scene):
    scene.camera.data.lens = 35.0
    return "Lens or focus of the camera changed"


def other_camera(scene):
    camera = bpy.data.objects.new("Second", scene.camera.data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return "The camera is 'Second' now; the bake is of 'Camera'"


def other_resolution(scene):
    scene.render.resolution_percentage = 50
    return "The picture has 32 x 24 pixels now; the bake has 64 x 48"


def move_object(_scene):
    bpy.data.objects["Sofa"].location.z = 1.0
    return "'Sofa' moved"


def bend(name):
    mesh = bpy.data.meshes[name]
    mesh.vertices[0].co.z = 0.25
    mesh.update()
    return f"Geometry '{name}' changed"


def move_vertex(_scene):
    return bend("Sofa")


def other_material(_scene):
    bpy.data.objects["Sofa"].material_slots[0].material = bpy.data.materials.new("Blue")
    return "'Sofa' has other materials"


def edit_material(_scene):
    node = bpy.data.materials["Red"].node_tree.nodes["Diffuse BSDF"]
    node.inputs["Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    return "Material 'Red' changed"


def add_modifier(_scene):
    bpy.data.objects["Sofa"].modifiers.new("Thick", "SOLIDIFY")
    return "Modifiers of 'Sofa' changed"


def hide(_scene):
    bpy.data.objects["Sofa"].hide_render = True
    return "'Sofa' was deleted or hidden"


def delete(_scene):
    bpy.data.objects.remove(bpy.data.objects["Sofa"])
    return "'Sofa' was deleted or hidden"


def add_object(scene):
    add_quad(scene, "Table")
    return "'Table' was added"


def other_world(scene):
    tree = scene.world.node_tree
    sky = tree.nodes.new("ShaderNodeTexEnvironment")
    sky.image = bpy.data.images.new("Sky", 8, 4, float_buffer=True)
    tree.links.new(sky.outputs["Color"], background(scene).inputs["Color"])
    return "The world changed"


def fewer_bounces(scene):
    scene.cycles.max_bounces = 1
    scene.update_tag()
    return "Bounces, filters or film of the render settings changed"


def shade_smooth(_scene):
    mesh = bpy.data.meshes["Sofa"]
    mesh.shade_smooth()
    mesh.update()
    return "Geometry 'Sofa' changed"


def paint_vertices(_scene):
    mesh = bpy.data.meshes["Sofa"]
    mesh.color_attributes.new("Dirt", "FLOAT_COLOR", "POINT")
    mesh.update()
    return "Geometry 'Sofa' changed"


def hide_collection(scene):
    bpy.context.view_layer.layer_collection.children["Furniture"].exclude = True
    return "Objects were hidden or shown by their collection"


def render_collection(scene):
    bpy.data.collections["Furniture"].hide_render = True
    return "Objects were hidden or shown by their collection"


def indirect_collection(scene):
    bpy.context.view_layer.layer_collection.children["Furniture"].indirect_only = True
    return "Holdout or Indirect Only of a collection changed"


def move_asset(_scene):
    bpy.data.objects["Leaf"].location.z = 1.0
    return "'Leaf' moved"


def move_vertex_of_asset(_scene):
    return bend("Leaf")


def other_pass_index(_scene):
    bpy.data.objects["Sofa"].pass_index = 3
    return "Colour, pass index or shadow terminator of 'Sofa' changed"


def override_materials(_scene):
    bpy.context.view_layer.material_override = bpy.data.materials["Red"]
    return "The view layer has another material override"


CHANGES = [
    shade_smooth,
    paint_vertices,
    hide_collection,
    render_collection,
    indirect_collection,
    move_asset,
    move_vertex_of_asset,
    move_camera,
    other_lens,
    other_camera,
    other_resolution,
    move_object,
    move_vertex,
    other_material,
    edit_material,
    add_modifier,
    hide,
    delete,
    add_object,
    other_world,
    fewer_bounces,
    other_pass_index,
    override_materials,
]


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_is_named_and_undone(baked, change):
    sentence = change(baked)
    assert said(baked) == [sentence]
    bpy.ops.ed.undo_push(message="changed")
    bpy.ops.ed.undo()
    assert said(bpy.context.scene) == []


def test_lights_and_selection_are_no_changes(baked):
    bpy.data.objects["Key"].location.x = 2.0
    bpy.data.objects["Sofa"].select_set(True)
    bpy.data.lights["Key"].energy = 5.0
    assert said(baked) == []


def test_a_brighter_world_is_relit_and_no_change(baked):
    live = FakeLive.made[-1]
    node = background(baked)
    node.inputs["Strength"].default_value = 3.0
    assert said(baked) == []
    assert live.requests[-1]["world"] == pytest.approx([3.0, 3.0, 3.0])
    node.inputs["Color"].default_value = (0.25, 0.5, 1.0, 1.0)
    assert said(baked) == []
    assert live.requests[-1]["world"] == pytest.approx([1.5, 3.0, 6.0])


def test_a_volume_of_the_world_is_a_change_and_its_light_stays_none(baked):
    tree = baked.world.node_tree
    fog = tree.nodes.new("ShaderNodeVolumeScatter")
    output = next(found for found in tree.nodes if found.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(fog.outputs[0], output.inputs["Volume"])
    assert said(baked) == ["The volume of the world changed"]
    background(baked).inputs["Strength"].default_value = 3.0
    assert said(baked) == ["The volume of the world changed"]
    fog.mute = True
    assert said(baked) == []


def test_shadows_of_transparent_parts_are_a_change(baked):
    material = bpy.data.objects["Sofa"].active_material
    material.use_transparent_shadow = False
    assert said(baked) == [f"Material '{material.name}' changed"]
    material.use_transparent_shadow = True
    assert said(baked) == []


def test_rules_of_lights_are_a_change(baked):
    light = next(obj for obj in baked.objects if obj.type == "LIGHT")
    light.data.use_shadow = False
    assert said(baked) == ["Shadow linking, bounces or Multiple Importance of a light changed"]
    light.data.use_shadow = True
    light.data.cycles.max_bounces = 1
    assert said(baked) == ["Shadow linking, bounces or Multiple Importance of a light changed"]
    light.data.cycles.max_bounces = 1024
    light.data.energy = 5.0
    assert said(baked) == []


def test_visibility_to_what_fog_scatters_is_a_change(baked):
    bpy.data.objects["Sofa"].visible_volume_scatter = False
    assert said(baked) == ["Visibility of 'Sofa' changed"]


def test_a_shadow_catcher_is_a_change(baked):
    bpy.data.objects["Sofa"].is_shadow_catcher = True
    assert said(baked) == ["Shadow Catcher of 'Sofa' was switched on or off"]


def test_a_bake_that_was_begun_under_a_darker_world_is_relit_as_the_present_one(baked):
    live = FakeLive.made[-1]
    live.tell(world_color=[0.25, 0.5, 0.5])
    assert said(baked) == []
    scheduler.request_picture(baked)
    assert live.requests[-1]["world"] == pytest.approx([2.0, 1.0, 1.0])
    assert shot.of(baked).changes.baked_fingerprints()["world"]["color"] == "0.25 0.5 0.5"


@pytest.fixture
def under_sky(lit, monkeypatch):
    """A bake under a sky that an empty turns, which nobody renders."""
    monkeypatch.setattr(worlds, "rendered", lambda _world, _size, _stop: np.ones((2, 4, 4), np.float32))
    lit.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 2, 0):
        lit.world.use_nodes = True
    tree = lit.world.node_tree
    sky, coordinates = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexSky", "TexCoord"))
    sky.sky_type, coordinates.object = "HOSEK_WILKIE", add(lit, "Turn", None)
    tree.links.new(coordinates.outputs["Object"], sky.inputs["Vector"])
    tree.links.new(sky.outputs[0], background(lit).inputs["Color"])
    bpy.context.view_layer.update()
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(lit) == []
    return lit


def hazier_sky(scene):
    scene.world.node_tree.nodes["Sky Texture"].turbidity = 5.0


def turn_sky(_scene):
    bpy.data.objects["Turn"].rotation_euler.z = 1.0


def no_sky(scene):
    scene.view_layers[0].use_sky = False
    scene.update_tag()


@pytest.mark.parametrize("change", [hazier_sky, turn_sky, no_sky])
def test_changes_of_a_rendered_world_are_named(under_sky, change):
    change(under_sky)
    assert said(under_sky) == ["The world changed"]


def test_a_brighter_rendered_world_is_relit_and_no_change(under_sky):
    background(under_sky).inputs["Strength"].default_value = 2.0
    assert said(under_sky) == []
    assert FakeLive.made[-1].requests[-1]["world"] == pytest.approx([2.0, 2.0, 2.0])


def test_a_turned_mapping_is_a_change(scene):
    material, tree, _ = add_material("Wood")
    mapping = tree.nodes.new("ShaderNodeMapping")
    add_quad(scene, material=material)
    before = fingerprints.all_fingerprints(scene, scene.camera)["material Wood"]
    assert fingerprints.all_fingerprints(scene, scene.camera)["material Wood"] == before
    mapping.inputs["Rotation"].default_value = (0.0, 0.0, 1.0)
    assert fingerprints.all_fingerprints(scene, scene.camera)["material Wood"] != before


def map_texture(material):
    material.node_tree.nodes["Checker Texture"].texture_mapping.scale = (2.0, 2.0, 2.0)


def use_other_output(material):
    material.node_tree.nodes["Material Output.001"].is_active_output = True


def displace(material):
    material.displacement_method = "BOTH"


@pytest.mark.parametrize("edit", [map_texture, use_other_output, displace])
def test_edits_of_materials_beside_their_sockets_are_changes(scene, edit):
    material, tree, _ = add_material("Wood")
    tree.nodes.new("ShaderNodeTexChecker")
    tree.nodes.new("ShaderNodeOutputMaterial").is_active_output = False
    add_quad(scene, material=material)
    before = fingerprints.all_fingerprints(scene, scene.camera)["material Wood"]
    edit(material)
    assert fingerprints.all_fingerprints(scene, scene.camera)["material Wood"] != before


def test_looking_comes_to_an_end_while_the_scene_is_edited(baked):
    found = shot.of(baked).changes
    bpy.data.objects["Sofa"].location.z = 1.0
    found.mark_all()
    for number in range(100):
        baked.frame_end = 300 + number
        baked.update_tag()
        bpy.context.view_layer.update()
        found.update(baked, 0.0)  # One step a turn.
    assert found.sentences == ["'Sofa' moved"]


def test_edits_while_the_bake_begins_are_not_taken_for_baked(lit):
    add_quad(lit, "Sofa")
    bpy.context.view_layer.update()
    start(lit)
    bpy.data.objects["Sofa"].location.x = 3.0
    assert said(lit) == ["'Sofa' was edited while the bake began"]


def test_undo_and_saving_do_not_forget_the_bake(lit, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    start(lit)
    folder = str(tmp_path / "bake")
    bpy.data.objects["Key"].location.x = 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert bpy.context.scene.relume.baked_folder == folder
    bpy.context.scene.relume.baked_folder = ""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert bpy.context.scene.relume.baked_absolute == folder


def test_record_outlives_the_file(baked, tmp_path):
    scheduler.tick()
    kept = record.read(tmp_path / "bake")
    assert kept.camera == "Camera" and "Sofa" in kept.receivers
    assert kept.fingerprints == record.of(baked, "map").fingerprints
    assert list(kept.maps.values()) == [kept.fingerprints["world"]["shape"]]
    bpy.data.objects["Sofa"].location.z = 1.0
    assert said(baked) == ["'Sofa' moved"]
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    shot.Shot.open(scene)
    scheduler.read_lights(scene)
    assert said(scene) == ["'Sofa' moved"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"format": "relume-shot", "version": 1}', '{"format": 1}', "null"])
def test_damaged_records_are_none(tmp_path, text):
    (tmp_path / record.FILE).write_text(text)
    assert record.read(tmp_path) is None
