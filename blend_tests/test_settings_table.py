"""No property of Blender is left without a decision, and what is said to be named or refused is."""

import bpy
import pytest
from blender_lists import own_properties
from settings_table import TABLE, decision_on

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add_light, add_material, add_quad, compositor

pytestmark = pytest.mark.every_version


@pytest.mark.parametrize("name", TABLE)
def test_each_property_is_decided_once(name):
    patterns = [pattern for names in TABLE[name].values() for pattern in names.split()]
    assert len(patterns) == len(set(patterns))
    undecided = [prop for prop in own_properties(name) if decision_on(name, prop) is None]
    assert not undecided, f"decide in settings_table.py what becomes of {undecided} of {name}"


def strips(scene):
    editor = scene.sequence_editor_create()
    made = editor.strips if hasattr(editor, "strips") else editor.sequences
    made.new_scene("Other", bpy.data.scenes.new("Other"), 1, 1)


def brighter(scene):
    tree = compositor(scene)
    kinds = ["CompositorNodeRLayers", "CompositorNodeExposure"]
    layers, exposure = (tree.nodes.new(kind) for kind in kinds)
    if bpy.app.version < (5, 0, 0):
        output = tree.nodes.new("CompositorNodeComposite")
    else:
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(layers.outputs["Image"], exposure.inputs[0])
    tree.links.new(exposure.outputs[0], output.inputs[0])


def second_layer(scene):
    scene.view_layers.new("Foreground")


def border(scene):
    scene.render.use_border, scene.render.border_min_x = True, 0.5


def set_render(name, value=True):
    return lambda scene: setattr(scene.render, name, value)


def set_cycles(name, value):
    return lambda scene: setattr(scene.cycles, name, value)


def set_object(name, value=True):
    return lambda scene: setattr(scene.objects["Plane"], name, value)


def set_light(name, value):
    return lambda scene: setattr(scene.objects["Lamp"].data.cycles, name, value)


@pytest.mark.parametrize(
    "deviate, words",
    [
        (set_render("use_freestyle"), "scene 'Scene': Freestyle's lines"),
        (border, "scene 'Scene': the cut of the render region"),
        (brighter, "scene 'Scene': the compositor"),
        (strips, "scene 'Scene': the video sequencer"),
        (second_layer, "of its view layers only 'ViewLayer' is in the picture, not 'Foreground'"),
        (set_cycles("sample_clamp_direct", 1.0), "clamping"),
        (set_light("is_caustics_light", True), "light 'Lamp'"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_setting_that_is_not_in_the_picture_is_named(scene, deviate, words):
    add_quad(scene)
    add_light(scene, "POINT", shadow_soft_size=0.2)
    before = warnings_of(scene)
    deviate(scene)
    assert any(words in warning for warning in set(warnings_of(scene)) - set(before)), warnings_of(scene)


def warnings_of(scene):
    found = []
    trace_settings(scene, found.append)
    return [*load_scene(scene).warnings, *found]


@pytest.mark.parametrize(
    "harmless",
    [compositor, set_render("use_simplify"), set_render("use_stamp"), set_cycles("use_light_tree", False)],
    ids=["empty compositor", "simplify", "stamp", "light tree"],
)
def test_nothing_is_said_of_what_changes_no_picture(scene, harmless):
    add_quad(scene)
    harmless(scene)
    assert warnings_of(scene) == []


def test_stereo_is_refused_with_a_way_out(scene):
    add_quad(scene)
    scene.render.use_multiview = True
    words = "Stereo views of scene 'Scene' are not supported; switch off Stereoscopy"
    with pytest.raises(Exception, match=words):
        load_scene(scene)


@pytest.mark.parametrize(
    "deviate",
    [
        set_object("pass_index", 3),
        set_object("color", (1.0, 0.0, 0.0, 1.0)),
        set_object("visible_glossy", False),
        set_render("resolution_x", 32),
        set_render("pixel_aspect_x", 2.0),
        lambda scene: setattr(scene.camera.data, "clip_start", 0.5),
        lambda scene: setattr(scene.camera.data.dof, "use_dof", True),
        lambda scene: setattr(scene.view_layers[0], "material_override", add_material("Clay")[0]),
        lambda scene: setattr(terminator_owner(scene), "shadow_terminator_geometry_offset", 0.5),
    ],
    ids=["pass index", "colour", "visibility", "resolution", "aspect", "clip", "focus", "override", "terminator"],
)
def test_what_is_read_changes_the_scene(scene, deviate):
    add_quad(scene)
    before = load_scene(scene).hash
    deviate(scene)
    assert load_scene(scene).hash != before


def terminator_owner(scene):
    plane = scene.objects["Plane"]
    return plane if hasattr(plane, "shadow_terminator_geometry_offset") else plane.cycles
