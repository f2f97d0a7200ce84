"""The lights of a look are put back into their places, all in one step of undo, or none and it is said why."""

import json
import math
from dataclasses import replace

import bpy
import numpy as np
import pytest
from look_steps import dial, scene_state, values

from addon.apply.writable import RefusedError
from addon.core.looks import from_json, to_json
from addon.ui import looks
from helpers import add_light, update


def move_everything(scene):
    """Other lights than before in every respect."""
    key, fill = bpy.data.objects["Key"], bpy.data.objects["Fill"]
    key.location, key.rotation_euler, key.scale = (5, 5, 5), (1, 0.5, 0), (2, 3, 1)
    key.data.energy, key.data.shape, key.data.size = 1.0, "SQUARE", 3.0
    fill.data.type = "SUN"
    fill.data.energy, fill.hide_render = 3.0, True
    update()


def test_lights_come_back_in_one_undo_step(rigged):
    before = scene_state(rigged)
    looks.snapshot(rigged)
    move_everything(rigged)
    moved = scene_state(rigged)
    bpy.ops.ed.undo_push(message="moved")
    assert bpy.ops.relume.restore_look("EXEC_DEFAULT", lights=True) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="restored")  # As the window does after an operator.
    update()
    assert scene_state(bpy.context.scene) == before
    bpy.ops.ed.undo()
    assert scene_state(bpy.context.scene) == moved


def test_a_child_of_a_moved_parent_comes_back_to_its_place(rigged):
    parent = bpy.data.objects.new("Parent", None)
    rigged.collection.objects.link(parent)
    key = bpy.data.objects["Key"]
    key.parent = parent
    parent.location = (1, 0, 0)
    update()
    looks.snapshot(rigged)
    before = np.array(key.matrix_world)
    parent.rotation_euler = (0, 0, math.pi / 2)
    update()
    assert not np.allclose(key.matrix_world, before, atol=1e-3)
    looks.restore(rigged, looks.active_look(rigged).look(), lights=True)
    update()
    assert np.allclose(key.matrix_world, before, atol=1e-5)


@pytest.fixture
def hung(rigged):
    """The fill hangs on the key, and a bulb on the fill by an empty between them; all stand askew."""
    add_light(rigged, "POINT", "Bulb", location=(0.3, 0.1, -0.4), shadow_soft_size=0.1)
    arm = bpy.data.objects.new("Arm", None)
    rigged.collection.objects.link(arm)
    chain = [bpy.data.objects[name] for name in ("Key", "Fill", "Arm", "Bulb")]
    for parent, child in zip(chain, chain[1:], strict=False):
        child.parent = parent
        child.rotation_euler = (0.2, 0.1, 0.4)
    update()
    return rigged


def places(*names):
    """Matrices of objects in the scene."""
    update()
    return [np.array(bpy.data.objects[name].matrix_world) for name in names]


@pytest.mark.parametrize("is_reversed", [False, True])
def test_lights_that_hang_on_lights_come_back_to_their_places(hung, is_reversed):
    look = looks.snapshot(hung).look()
    look = replace(look, lights=tuple(sorted(look.lights, key=lambda light: light["name"], reverse=is_reversed)))
    before = places("Key", "Fill", "Bulb")
    for name in ("Key", "Fill", "Bulb"):
        bpy.data.objects[name].location.x += 1.0
        bpy.data.objects[name].rotation_euler.z += 0.5
    update()
    looks.restore(hung, look, lights=True)
    assert np.allclose(places("Key", "Fill", "Bulb"), before, atol=1e-5)


def solved_key(scene, **changes):
    """A look that moves the key alone, as solving makes them."""
    look = looks.snapshot(scene).look()
    state = next(light for light in look.lights if light["name"] == "Key")
    moved = [[*row[:3], row[3] + 1.0] for row in state["matrix"][:3]] + [state["matrix"][3]]
    return replace(look, lights=(state | {"matrix": moved} | changes,))


def test_lights_that_hang_on_one_that_moves_stay_where_they_are(hung):
    key, fill, bulb = places("Key", "Fill", "Bulb")
    bpy.data.objects["Bulb"].keyframe_insert("location")  # Nothing is to be written: the fill has come back.
    looks.restore(hung, solved_key(hung), lights=True)
    found = places("Key", "Fill", "Bulb")
    assert np.allclose(found[0][:3, 3], key[:3, 3] + 1.0, atol=1e-5)
    assert np.allclose(found[1:], [fill, bulb], atol=1e-5)


def test_a_rig_that_comes_along_writes_nothing_to_its_lights(hung):
    look = looks.snapshot(hung).look()
    before = places("Key", "Fill", "Bulb")
    bpy.data.objects["Key"].location.x += 2.0
    bpy.data.objects["Bulb"].keyframe_insert("location")  # Could not be written, and need not.
    update()
    looks.restore(hung, look, lights=True)
    assert np.allclose(places("Key", "Fill", "Bulb"), before, atol=1e-5)


def test_a_light_that_could_not_be_kept_in_its_place_is_refused_by_name(hung):
    bpy.data.objects["Fill"].keyframe_insert("location")
    before = scene_state(hung)
    says = "light 'Fill' hangs on a light that moves, and has animation on its location"
    with pytest.raises(RefusedError, match=says):
        looks.restore(hung, solved_key(hung), lights=True)
    assert scene_state(hung) == before


def constrained(_scene):
    bpy.data.objects["Key"].constraints.new("COPY_LOCATION").name = "Follow"
    return "light 'Key' is placed by its constraint 'Follow'"


def driven(_scene):
    bpy.data.objects["Key"].data.driver_add("size")
    return "light 'Key' has a driver on its size"


def animated(_scene):
    bpy.data.objects["Key"].keyframe_insert("location")
    return "light 'Key' has animation on its location"


@pytest.mark.parametrize("spoil", [constrained, driven, animated])
def test_what_cannot_be_written_is_refused_by_name_and_nothing_is(rigged, spoil):
    looks.snapshot(rigged)
    dial(rigged)
    move_everything(rigged)
    says = spoil(rigged)
    update()
    before = values(rigged), scene_state(rigged)
    with pytest.raises(RefusedError, match=says):
        looks.restore(rigged, looks.active_look(rigged).look(), lights=True)
    assert (values(rigged), scene_state(rigged)) == before


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"type": "LASER"}, "cannot be of type 'LASER'"),
        ({"type": "point"}, "cannot be of type 'point'"),
        ({"type": ""}, "cannot be of type ''"),
        ({"settings": {"shape": "STAR"}}, "cannot have 'STAR' as its shape"),
        ({"settings": {"energy": [1.0, 2.0, 3.0]}}, r"cannot have \[1.0, 2.0, 3.0\] as its energy"),
        ({"settings": {"color": 1.0}}, "cannot have 1.0 as its color"),
        ({"settings": {"energy": True}}, "cannot have True as its energy"),
    ],
)
def test_hostile_values_are_refused_before_anything_is_written(rigged, change, says):
    data = json.loads(to_json(looks.snapshot(rigged).look()))
    light = next(light for light in data["lights"] if light["name"] == "Key")
    light |= change
    other = next(light for light in data["lights"] if light["name"] == "Fill")
    other["settings"]["energy"] = 3.0
    before = scene_state(rigged)
    with pytest.raises(RefusedError, match=says):
        looks.restore(rigged, from_json(json.dumps(data)), lights=True)
    assert scene_state(rigged) == before
