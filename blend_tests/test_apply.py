"""Apply to lights keeps the picture, is one undo step, and writes all or nothing."""

import json

import bpy
import numpy as np
import pytest
import relume

from addon.apply.lights import scaled
from addon.apply.writable import RefusedError
from addon.core.rows import GROUP, STATIC, WORLD, Row
from addon.engine.reading.scene import load_scene
from addon.live import rows
from addon.ui import mixer
from helpers import add_light, add_material, add_quad, add_world, background, row, update

VERSION = bpy.app.version


pytestmark = [pytest.mark.every_version, pytest.mark.usefixtures("registered_for_all_files")]


@pytest.fixture
def room(scene):
    """Three lights, two of them in a group, over a lit floor, with a world and something that glows."""
    material, tree, output = add_material("White")
    tree.links.new(tree.nodes.new("ShaderNodeBsdfDiffuse").outputs[0], output.inputs["Surface"])
    add_quad(scene, "Floor", 4.0, material)
    material, tree, output = add_material("Glow")
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], output.inputs["Surface"])
    add_quad(scene, "Lamp", 0.3, material).location.z = 0.5
    rig = bpy.data.collections.new("Rig")
    scene.collection.children.link(rig)
    for name, kind, x in (("Key", "POINT", -1.0), ("Fill", "AREA", 1.0), ("Sun", "SUN", 0.0)):
        light = add_light(scene, kind, name, location=(x, 0, 2), color=(1.0, 0.8, 0.6))
        light.data.energy = 2.0 if kind == "SUN" else 50.0
        if kind != "SUN":
            rig.objects.link(light)
            scene.collection.objects.unlink(light)
    add_world(scene)
    update()
    return scene


class Native:
    """A bake of the scene, relit by the native module."""

    def __init__(self, scene, folder):
        load_scene(scene).bake(folder, json.dumps({"samples": 8, "threads": 1})).result()
        self.world = world_color(scene)
        self.relighter = relume.Relighter(folder, device="cpu")

    def picture(self, scene):
        """Under the scene's present lights and rows."""
        lights = json.loads(load_scene(scene).lights())
        mix = rows.mix(scene, [light["name"] for light in lights])
        for light in lights:
            gain = mix["gains"][light["name"]]
            light["radiance"] = [a * b for a, b in zip(light["radiance"], gain, strict=True)]
        layers = self.relighter.relight(json.dumps(lights), denoise=False)
        out = sum(layers["lights"].values()) if layers["lights"] else 0.0
        # The bake holds the world as it was.
        world = layers["world"] * (world_color(scene) / self.world * mix["world"])
        return out + layers["static"] * np.array(mix["static"]) + world


def world_color(scene):
    """Colour times strength of the world's Background node."""
    node = background(scene)
    return np.array(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value


def dial(scene):
    """Values in every kind of row."""
    key, fill = row(scene, "Key"), row(scene, "Fill")
    key.exposure, key.multiplier, key.color = 1.0, 1.5, (1.0, 0.5, 0.25)
    fill.use_kelvin, fill.kelvin, fill.exposure = True, 3000.0, -0.5
    row(scene, "Sun").on = False
    group, glow = row(scene, "Rig", GROUP), row(scene, "Emissive Materials", STATIC)
    group.multiplier, group.color, glow.exposure = 0.7, (0.9, 1.0, 0.8), 1.0
    row(scene, "World", WORLD).color = (2.0, 1.0, 0.5)


def test_the_native_picture_stays(room, tmp_path):
    native = Native(room, tmp_path)
    neutral = native.picture(room)
    dial(room)
    before = native.picture(room)
    assert np.abs(before - neutral).max() > 0.1 * neutral.max(), "the rows do something"
    mixer.apply_to_lights(room)
    update()
    assert np.abs(native.picture(room) - before).max() < 1e-5 * before.max()
    assert row(room, "Key").values() == Row("Key")
    assert row(room, "Emissive Materials", STATIC).exposure == 1.0
    assert row(room, "Sun").hidden and row(room, "Sun").on


def test_a_soloed_picture_stays(room, tmp_path):
    native = Native(room, tmp_path)
    row(room, "Fill").solo = True
    before = native.picture(room)
    mixer.apply_to_lights(room)
    update()
    assert np.abs(native.picture(room) - before).max() < 1e-5 * before.max()
    assert bpy.data.objects["Key"].hide_render and bpy.data.objects["Key"].data.energy == 50.0
    assert not row(room, "Emissive Materials", STATIC).on


def state(scene):
    """All that Apply may write."""
    lights = [obj for obj in scene.objects if obj.type == "LIGHT"]
    return {
        obj.name: (obj.data.energy, tuple(obj.data.color), obj.hide_render, obj.hide_viewport) for obj in lights
    } | {"rows": [row.values() for row in rows.present_rows(scene)]}


def test_apply_is_one_undo_step(room):
    dial(room)
    bpy.ops.ed.undo_push(message="dialled")
    before = state(room)
    assert bpy.ops.relume.apply_to_lights() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="apply")  # As the window does after an operator.
    applied = state(bpy.context.scene)
    assert applied != before
    bpy.ops.ed.undo()
    assert state(bpy.context.scene) == before
    bpy.ops.ed.redo()
    assert state(bpy.context.scene) == applied


def test_operator_does_what_the_function_does(room):
    dial(room)
    bpy.ops.ed.undo_push(message="dialled")
    mixer.apply_to_lights(room)
    by_function = state(room)
    bpy.ops.ed.undo_push(message="function")
    bpy.ops.ed.undo()
    bpy.ops.relume.apply_to_lights()
    assert state(bpy.context.scene) == by_function


def test_read_from_lights_drops_the_mix_and_writes_nothing(room):
    lights = {name: value for name, value in state(room).items() if name != "rows"}
    dial(room)
    assert bpy.ops.relume.read_from_lights() == {"FINISHED"}
    after = state(room)
    assert all(found == Row(found.name, found.kind) for found in after.pop("rows"))
    assert after == lights


@pytest.mark.skipif(VERSION < (4, 5, 0), reason="lights have no temperature before Blender 4.5")
def test_kelvin_becomes_the_lights_own_temperature(room):
    dial(room)
    mixer.apply_to_lights(room)
    fill = bpy.data.objects["Fill"].data
    assert fill.use_temperature and fill.temperature == 3000.0
    row(room, "Fill").use_kelvin = True
    mixer.apply_to_lights(room)
    assert fill.temperature == 3000.0, "a light with a temperature is tinted by its colour"
    assert max(fill.color) == pytest.approx(1.0)


def test_brightness_goes_into_energy_and_tint_into_color():
    energy, color = scaled(10.0, (1.0, 0.5, 0.0), (4.0, 4.0, 4.0))
    assert (energy, color) == (40.0, [1.0, 0.5, 0.0])
    energy, color = scaled(10.0, (1.0, 0.5, 0.0), (0.0, 3.0, 9.0))
    assert energy * np.array(color) == pytest.approx([0.0, 15.0, 0.0]) and max(color) == 1.0
    assert scaled(10.0, (0.0, 0.0, 0.0), (2.0, 1.0, 1.0)) == (20.0, [0.0, 0.0, 0.0])


def test_world_strength_and_color_are_written(room):
    node = add_world(room)
    update()
    row(room, "World", WORLD).multiplier, row(room, "World", WORLD).color = 2.0, (1.0, 0.5, 1.0)
    mixer.apply_to_lights(room)
    assert node.inputs["Strength"].default_value == pytest.approx(1.0)
    assert list(node.inputs["Color"].default_value)[:3] == pytest.approx([0.2, 0.15, 0.4])
    assert node.inputs["Color"].default_value[3] == 1.0


def linked(scene, tmp_path):
    obj = bpy.data.objects["Key"]
    bpy.data.libraries.write(str(tmp_path / "rig.blend"), {obj})
    bpy.data.objects.remove(obj)
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_have, wanted):
        wanted.objects = ["Key"]
    scene.collection.objects.link(wanted.objects[0])
    update()
    row(scene, "Key [rig.blend]").multiplier = 2.0
    return "light 'Key' is linked"


def driven(scene, _folder):
    bpy.data.objects["Key"].data.driver_add("energy")
    row(scene, "Key").multiplier = 2.0
    return "light 'Key' has a driver on its energy"


def animated(scene, _folder):
    bpy.data.objects["Key"].data.keyframe_insert("color", index=1)
    row(scene, "Key").color = (1.0, 0.0, 0.0)
    return "light 'Key' has animation on its color"


def animated_in_a_strip(scene, _folder):
    light = bpy.data.objects["Key"].data
    light.keyframe_insert("energy")
    data = light.animation_data
    strip = data.nla_tracks.new().strips.new("Strip", 1, data.action)
    if VERSION >= (4, 4, 0):
        strip.action_slot = data.action_slot
    data.action = None
    row(scene, "Key").multiplier = 2.0
    return "light 'Key' has animation on its energy"


def hidden_by_animation(scene, _folder):
    bpy.data.objects["Key"].keyframe_insert("hide_render")
    row(scene, "Key").on = False
    return "light 'Key' has animation on its hide render, and would have to be hidden"


def shared(scene, _folder):
    twin = bpy.data.objects.new("Twin", bpy.data.objects["Key"].data)
    scene.collection.objects.link(twin)
    update()
    row(scene, "Twin").multiplier = 2.0
    return "lights 'Key' and 'Twin' share|lights 'Twin' and 'Key' share"


def no_background(scene, _folder):
    tree = scene.world.node_tree
    output = tree.get_output_node("CYCLES")
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], output.inputs["Surface"])
    row(scene, "World", WORLD).multiplier = 2.0
    return "world 'Sky' is not one Background node"


def tinted_texture(scene, _folder):
    tree = scene.world.node_tree
    tree.links.new(tree.nodes.new("ShaderNodeTexEnvironment").outputs[0], background(scene).inputs["Color"])
    row(scene, "World", WORLD).color = (1.0, 0.5, 0.5)
    return "world 'Sky' has nodes that feed its color"


def animated_world(scene, _folder):
    background(scene).inputs["Strength"].keyframe_insert("default_value")
    row(scene, "World", WORLD).multiplier = 2.0
    return "world 'Sky' has animation on its strength"


REFUSED = [
    linked, driven, animated, animated_in_a_strip, hidden_by_animation, shared, no_background, tinted_texture,
    animated_world,
]  # fmt: skip


@pytest.mark.parametrize("spoil", REFUSED)
def test_what_cannot_be_written_is_refused_by_name_and_nothing_is(room, tmp_path, spoil):
    row(room, "Fill").exposure = 1.0
    says = spoil(room, tmp_path).split("|")
    before, strength = state(room), room.world.node_tree
    strength = [node.inputs["Strength"].default_value for node in strength.nodes if "Strength" in node.inputs]
    with pytest.raises(RefusedError) as error:
        mixer.apply_to_lights(room)
    assert any(text in str(error.value) for text in says), str(error.value)
    with pytest.raises(RuntimeError, match="Nothing was written"):
        bpy.ops.relume.apply_to_lights()
    assert state(room) == before
    nodes = [node for node in room.world.node_tree.nodes if "Strength" in node.inputs]
    assert [node.inputs["Strength"].default_value for node in nodes] == strength


def test_what_needs_no_writing_is_no_obstacle(room, tmp_path):
    driven(room, tmp_path)
    row(room, "Key").multiplier = 1.0
    row(room, "Fill").exposure = 1.0
    mixer.apply_to_lights(room)
    assert bpy.data.objects["Fill"].data.energy == 100.0


def test_lights_that_share_data_are_written_once(room):
    twin = bpy.data.objects.new("Twin", bpy.data.objects["Key"].data)
    room.collection.objects.link(twin)
    update()
    row(room, "Key").multiplier = row(room, "Twin").multiplier = 2.0
    mixer.apply_to_lights(room)
    assert twin.data.energy == 100.0


def test_a_hidden_light_is_shown_again_from_its_row(room):
    row(room, "Sun").on = False
    mixer.apply_to_lights(room)
    assert bpy.ops.relume.show_light(light="Sun") == {"FINISHED"}
    update()
    sun = bpy.data.objects["Sun"]
    assert not sun.hide_render and not sun.hide_viewport and not row(room, "Sun").hidden


def test_a_light_is_selected_by_its_row(room):
    bpy.data.objects["Floor"].select_set(True)
    assert bpy.ops.relume.select_light(light="Fill") == {"FINISHED"}
    assert [obj.name for obj in bpy.context.view_layer.objects.selected] == ["Fill"]
    assert bpy.context.view_layer.objects.active.name == "Fill"
    bpy.data.objects["Key"].hide_viewport = True
    assert "hidden" in mixer.select_light(bpy.context, "Key")
    assert "not an object" in mixer.select_light(bpy.context, "Nobody")


def test_closed_groups_and_searches_leave_rows_out(room):
    items = room.relume_mix.rows
    names = lambda search="": {  # noqa: E731
        item.name
        for item, shown in zip(items, mixer.shown_rows(items, [item.order for item in items], search), strict=True)
        if shown
    }
    everything = {"Rig", "Key", "Fill", "Sun", "World", "Emissive Materials"}
    assert names() == everything
    row(room, "Rig", GROUP).open = False
    assert names() == everything - {"Key", "Fill"}
    assert names("KE") == {"Key"}
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    update()
    assert names() == everything - {"Key", "Fill", "Sun"}
