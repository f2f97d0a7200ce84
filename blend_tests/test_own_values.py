"""Values of rows in single shots: in mixes, looks, files, and when shots come and go."""

import json

import bpy
import numpy as np
import pytest

from addon.core.looks import LookError, from_json, to_json
from addon.core.rows import is_neutral
from addon.core.solve import SolveError
from addon.engine.solve import solving
from addon.export.current_shot import entries
from addon.live import rows
from addon.ui import looks, mixer
from addon.ui.solve import operators
from helpers import add_world, background, row, update

pytestmark = pytest.mark.every_version


@pytest.fixture
def listed(rigged):
    """Three cameras, each with a shot; the first is chosen."""
    for name in ("Close", "Top"):
        rigged.collection.objects.link(bpy.data.objects.new(name, bpy.data.cameras.new(name)))
    update()
    bpy.ops.relume.add_cameras()
    rows.sync(rigged)
    return rigged


def choose(scene, name, light="Key"):
    """Makes a shot the current one, and the row of a light the active one."""
    scene.relume_shots.active = scene.relume_shots.items.find(name)
    scene.relume_mix.active = scene.relume_mix.rows.find(light)


def dial(scene, name, light="Key", **values):
    """Gives the row of a light values in one shot."""
    choose(scene, name, light)
    assert bpy.ops.relume.only_this_shot() == {"FINISHED"}
    own = row(scene, light).shown(rows.current_key(scene))
    for key, value in values.items():
        setattr(own, key, value)


def gains(scene, light="Key"):
    """First channel of the gain of a light in each shot."""
    mixes = {entry.name: rows.mix(scene, ["Key", "Fill"], entry.key) for entry in entries(scene)}
    return {name: found["gains"][light][0] for name, found in mixes.items()}


def test_shots_differ_where_that_is_wanted(listed):
    row(listed, "Key").exposure = 1.0
    assert gains(listed) == {"Camera": 2.0, "Close": 2.0, "Top": 2.0}
    dial(listed, "Close", exposure=-1.0)
    dial(listed, "Top", on=False)
    assert gains(listed) == {"Camera": 2.0, "Close": 0.5, "Top": 0.0}
    assert gains(listed, "Fill") == {"Camera": 1.0, "Close": 1.0, "Top": 1.0}
    row(listed, "Key").multiplier = 3.0
    assert gains(listed) == {"Camera": 6.0, "Close": 0.5, "Top": 0.0}, "the common values are those of the others"
    choose(listed, "Close")
    assert bpy.ops.relume.only_this_shot(only=False) == {"FINISHED"}
    assert gains(listed) == {"Camera": 6.0, "Close": 6.0, "Top": 0.0}


def test_groups_and_solo_act_as_in_other_shots(listed):
    group = row(listed, "Rig", "GROUP")
    rows.give_own_values(group, "Close", group.values())
    rows.own_values(group, "Close").exposure = 2.0
    assert gains(listed, "Fill") == {"Camera": 1.0, "Close": 4.0, "Top": 1.0}
    row(listed, "Key").solo = True
    assert gains(listed, "Fill") == {"Camera": 0.0, "Close": 0.0, "Top": 0.0}


def test_own_values_survive_renaming_undo_and_the_file(listed, tmp_path):
    dial(listed, "Close", exposure=-1.0)
    entries(listed)[1].name = "Closer"
    bpy.data.objects["Close"].name = "Lens"
    bpy.data.objects["Key"].name = "Sunny"
    rows.sync(listed)
    assert rows.mix(listed, ["Sunny"], "Close")["gains"]["Sunny"][0] == 0.5
    bpy.ops.ed.undo_push(message="before")
    scene = bpy.context.scene
    rows.own_values(row(scene, "Sunny"), "Close").exposure = 3.0
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert rows.mix(scene, ["Sunny"], "Close")["gains"]["Sunny"][0] == 0.5
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shots.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shots.blend"))
    assert rows.mix(bpy.context.scene, ["Sunny"], "Close")["gains"]["Sunny"][0] == 0.5


def test_a_shot_that_is_removed_leaves_nothing_to_a_new_one_of_its_name(listed):
    dial(listed, "Close", exposure=-1.0)
    assert bpy.ops.relume.remove_shot() == {"FINISHED"}
    assert bpy.ops.relume.add_cameras() == {"FINISHED"}
    assert entries(listed)[2].key == "Close" and gains(listed)["Close"] == 1.0


def test_without_a_listed_shot_there_is_no_button(rigged):
    rows.sync(rigged)
    rigged.relume_mix.active = rigged.relume_mix.rows.find("Key")
    assert not bpy.ops.relume.only_this_shot.poll()
    bpy.ops.relume.add_cameras()
    assert bpy.ops.relume.only_this_shot.poll()


def test_a_look_brings_the_values_of_each_shot_back(listed, tmp_path):
    dial(listed, "Close", exposure=-1.0, color=(1.0, 0.5, 0.25))
    dial(listed, "Top", on=False)
    look = looks.snapshot(listed, "Both").look()
    assert look.shots.keys() == {"Close", "Top"} and from_json(to_json(look)) == look
    mixer.reset(listed)
    assert gains(listed) == {"Camera": 1.0, "Close": 1.0, "Top": 1.0}
    plain = looks.snapshot(listed, "Plain").look()
    assert json.loads(to_json(plain))["version"] == 1, "an older Relume reads it"
    assert str(looks.restore(listed, look)) == ""
    assert gains(listed) == {"Camera": 1.0, "Close": 0.5, "Top": 0.0}
    assert tuple(row(listed, "Key").shown("Close").color) == (1.0, 0.5, 0.25)
    choose(listed, "Top")
    bpy.ops.relume.remove_shot()
    assert "shot 'Top'" in str(looks.restore(listed, look))
    looks.export_file(look, tmp_path / "look.json")
    _, outcome = looks.import_file(listed, tmp_path / "look.json")
    assert outcome.missing == ["shot 'Top'"]
    looks.restore(listed, plain)
    assert gains(listed) == {"Camera": 1.0, "Close": 1.0}, "a look is all values of all shots"


@pytest.mark.parametrize("shots", [[], {"A": {}}, {"A": [{"name": "Key"}]}, {"A\n": []}])
def test_damaged_values_of_shots_are_named(listed, shots):
    text = json.loads(to_json(looks.current(listed, "Look")))
    with pytest.raises(LookError, match="damaged look"):
        from_json(json.dumps(text | {"version": 2, "shots": shots}))


def shining(scene):
    """Light of each shot: energies of lights that are not hidden, times gains."""
    lights = {light.name: light for light in scene.objects if light.type == "LIGHT"}
    found = {}
    for entry in entries(scene):
        gains = rows.mix(scene, lights, entry.key)["gains"]
        for name, light in lights.items():
            power = np.array(light.data.color) * light.data.energy * np.array(gains[name])
            found[entry.name, name] = tuple(power * (not light.hide_render))
    return found


def test_applying_keeps_the_light_of_every_shot(listed):
    row(listed, "Key").exposure = 1.0
    row(listed, "Fill").multiplier = 3.0
    group = row(listed, "Rig", "GROUP")
    group.exposure = -1.0
    dial(listed, "Close", exposure=-1.0, color=(1.0, 0.5, 0.25))
    dial(listed, "Top", on=False)
    rows.give_own_values(group, "Close", group.values())
    rows.own_values(group, "Close").exposure = 2.0
    before, energy = shining(listed), bpy.data.lights["Key"].energy
    assert bpy.ops.relume.apply_to_lights() == {"FINISHED"}
    assert bpy.data.lights["Key"].energy == pytest.approx(2.0 * energy)
    assert all(is_neutral(found.values()) for found in rows.present_rows(listed))
    after = shining(listed)
    assert {place: pytest.approx(light, rel=1e-5) for place, light in before.items()} == after
    assert gains(listed) == pytest.approx({"Camera": 1.0, "Close": 0.25, "Top": 0.0})
    assert gains(listed, "Fill") == pytest.approx({"Camera": 1.0, "Close": 8.0, "Top": 1.0})
    assert len(group.own) == 0 and [own.shot for own in row(listed, "Fill").own] == ["Close"]
    assert bpy.ops.relume.apply_to_lights() == {"FINISHED"}
    assert shining(listed) == after, "there was nothing more to write"


def test_applying_leaves_alone_what_only_single_shots_have(listed):
    row(listed, "Key").exposure = 1.0
    choose(listed, "Close")
    bpy.ops.relume.copy_for_shot(light="Key")
    row(listed, "Fill").color = (1.0, 0.0, 0.0)
    dial(listed, "Top", "Fill", color=(1.0, 1.0, 0.0), exposure=2.0)
    before = shining(listed)
    assert mixer.apply_to_lights(listed) == ["Fill", "Key Close"]
    after = shining(listed)
    assert {place: pytest.approx(light, rel=1e-5) for place, light in before.items()} == after
    assert not bpy.data.objects["Key Close"].hide_render and not row(listed, "Key Close").on
    assert tuple(row(listed, "Fill").color) == (1.0, 0.0, 0.0) and row(listed, "Fill").shown("Top").exposure == 2.0


def test_applying_keeps_the_world_and_emissive_materials_of_every_shot(listed):
    add_world(listed)
    rows.sync(listed)
    world, static = row(listed, "World", "WORLD"), row(listed, "Emissive Materials", "STATIC")
    world.exposure, static.exposure = 1.0, 1.0
    for found, exposure in ((world, 3.0), (static, -1.0)):
        rows.give_own_values(found, "Top", found.values())
        rows.own_values(found, "Top").exposure = exposure
    strength = background(listed).inputs["Strength"].default_value
    assert mixer.apply_to_lights(listed) == []
    assert background(listed).inputs["Strength"].default_value == pytest.approx(2.0 * strength)
    found = {entry.name: rows.mix(listed, [], entry.key) for entry in entries(listed)}
    assert [mix["world"][0] for mix in found.values()] == pytest.approx([1.0, 1.0, 4.0])
    assert [mix["static"][0] for mix in found.values()] == pytest.approx([2.0, 2.0, 0.5])
    world.on = False
    rows.own_values(world, "Top").exposure = 1.0
    assert mixer.apply_to_lights(listed) == ["World"]
    assert background(listed).inputs["Strength"].default_value == pytest.approx(2.0 * strength)
    assert not world.on and rows.mix(listed, [], "Top")["world"][0] == pytest.approx(8.0)


def test_lights_that_share_data_are_not_written_where_one_is_kept(listed):
    row(listed, "Key").exposure = 1.0
    choose(listed, "Close")
    bpy.ops.relume.copy_for_shot(light="Key")
    bpy.data.objects["Key Close"].data = bpy.data.lights["Key"]
    with pytest.raises(RuntimeError, match="share the data 'Key' and have different rows"):
        bpy.ops.relume.apply_to_lights()


def test_a_solve_is_about_all_shots(listed, monkeypatch):
    dial(listed, "Close", exposure=-1.0)
    monkeypatch.setattr(solving, "ready_shot", lambda _: None)
    with pytest.raises(SolveError, match="'Close'"):
        operators.begin(listed)


def test_resetting_a_row_is_about_the_current_shot_and_resetting_all_about_all(listed):
    row(listed, "Key").exposure = 1.0
    dial(listed, "Close", exposure=-1.0)
    assert bpy.ops.relume.reset_row() == {"FINISHED"}
    assert gains(listed) == {"Camera": 2.0, "Close": 1.0, "Top": 2.0}
    assert bpy.ops.relume.read_from_lights() == {"FINISHED"}
    assert gains(listed) == {"Camera": 1.0, "Close": 1.0, "Top": 1.0}
    assert len(row(listed, "Key").own) == 0


def test_a_copy_of_a_light_is_on_in_one_shot_alone(listed):
    row(listed, "Key").exposure = 1.0
    choose(listed, "Close")
    assert bpy.ops.relume.copy_for_shot(light="Key") == {"FINISHED"}
    copy = bpy.context.view_layer.objects.active
    assert copy.name == "Key Close" and copy.data != bpy.data.objects["Key"].data
    assert rows.active_row(listed).name == "Key Close"
    found = {entry.name: rows.mix(listed, ["Key", "Key Close"], entry.key)["gains"] for entry in entries(listed)}
    assert {name: (mix["Key"][0], mix["Key Close"][0]) for name, mix in found.items()} == {
        "Camera": (2.0, 0.0),
        "Close": (0.0, 2.0),
        "Top": (2.0, 0.0),
    }
    listed.relume_shots.items.clear()
    with pytest.raises(RuntimeError, match="choose a light"):
        bpy.ops.relume.copy_for_shot(light="Key")
