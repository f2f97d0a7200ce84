"""Results of solving are looks, compared with the state before, and written when told to."""

import json

import bpy
import numpy as np
import pytest
from solve_steps import begin, finish, solve, state_of

from addon.apply.writable import RefusedError
from addon.core.looks import from_json
from addon.core.rows import WORLD
from addon.core.solve import SolveError
from addon.engine.solve.request import strokes_of
from addon.live import rows
from addon.ui import looks
from addon.ui.solve import operators, results
from addon.viewport import compare as pairs
from fake_solve import light
from helpers import add_quad, add_world, row, update


def test_the_result_is_a_look_compared_with_before(painted):
    before = state_of(painted)
    report = [{"text": "Brighter: 0.9 of 1 stops", "met": False}]
    found = solve(painted, changed=[light("Key", "AREA")], report=report, warnings=["Goals disagree"])
    assert [look.name for look in painted.relume_looks.items] == ["Before", "Solve 1"]
    assert all(look.thumbnail for look in painted.relume_looks.items)
    assert looks.active_look(painted).uid == found.entry and state_of(painted) == before
    pair = pairs.pair_of(painted)
    assert pair.labels == ("Solve 1", "Before") and pair.a.serial > pair.b.serial
    kept = json.loads(painted.relume_solve.report)
    assert kept["lines"] == report and kept["notes"] == ["Goals disagree"]
    solve(painted, changed=[light("Key", "AREA")])
    assert [look.name for look in painted.relume_looks.items] == ["Before", "Solve 1", "Solve 2"]


@pytest.mark.parametrize(
    ("kind", "settings", "written"),
    [
        (
            "SPOT",
            {"spot_size": 0.6, "spot_blend": 0.25, "radius": 0.2},
            ("spot_size", "spot_blend", "shadow_soft_size"),
        ),
        ("SUN", {"angle": 0.12}, ("angle",)),
        ("POINT", {"radius": 0.3, "use_soft_falloff": False}, ("shadow_soft_size", "use_soft_falloff")),
    ],
)
def test_new_lights_of_every_type_are_made_as_solved(painted, kind, settings, written):
    solve(painted, added=[light("Relume Light", kind, (0.0, 1.0, 2.5), **settings)])
    assert bpy.ops.relume.apply_solved() == {"FINISHED"}
    data = painted.objects["Relume Light"].data
    assert data.type == kind and data.energy == 50.0 and tuple(data.color) == (1.0, 0.5, 0.25)
    for name, value in zip(written, settings.values(), strict=True):
        assert getattr(data, name) == pytest.approx(value), name


def test_apply_writes_lights_and_makes_new_ones_in_one_undo_step(painted):
    bpy.ops.ed.undo_push(message="painted")
    row(painted, "Key").exposure = 1.0
    new = light("Relume Light", "AREA", (0.0, 1.0, 2.5), shape="RECTANGLE", size=0.5, size_y=0.25)
    changed = light("Key", "AREA", (3.0, 2.0, 1.0), energy=300.0, size=0.75)
    solve(painted, changed=[changed], added=[new], removed=["Fill"])
    bpy.ops.ed.undo_push(message="solved")  # As the window does after an operator.
    before = state_of(painted)
    assert bpy.ops.relume.apply_solved() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="applied")
    update()
    key, fill, made = (painted.objects[name] for name in ("Key", "Fill", "Relume Light"))
    assert key.data.energy == 300.0 and key.data.size == 0.75 and tuple(key.location) == (3.0, 2.0, 1.0)
    assert key.data.shape == "DISK", "what was not solved stays"
    assert fill.hide_render and fill.hide_viewport
    assert made.data.type == "AREA" and made.data.shape == "RECTANGLE" and made.data.size_y == 0.25
    assert [found.name for found in made.users_collection] == ["Relume"] and tuple(made.location) == (0.0, 1.0, 2.5)
    assert row(painted, "Key").exposure == 0.0, "its gain is in its energy now"
    assert row(painted, "Relume Light").on and pairs.pair_of(painted) is None
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert state_of(scene) == before and "Relume Light" not in scene.objects
    assert looks.active_look(scene).name == "Solve 1" and row(scene, "Key").exposure == 1.0


def test_what_was_applied_is_not_asked_for_again(painted):
    bpy.ops.relume.draw_rectangle(rectangle=(0.1, 0.2, 0.5, 0.6), goal="warmer")
    solve(painted, changed=[light("Key", "AREA")])
    settings = painted.relume_solve
    assert strokes_of(painted) and len(settings.regions) == 1, "until it is applied"
    bpy.ops.relume.apply_solved()
    assert strokes_of(painted) == () and len(settings.regions) == 0
    assert json.loads(settings.report)["applied"] is True
    with pytest.raises(SolveError, match="Say what the picture should do"):
        finish(operators.begin(painted))


def test_applying_twice_makes_new_lights_once(painted):
    solve(painted, changed=[light("Key", "AREA")], added=[light("Relume Light")])
    for _ in range(2):
        assert bpy.ops.relume.apply_solved() == {"FINISHED"}
        update()
    assert sum(obj.name.startswith("Relume Light") for obj in painted.objects) == 1
    assert row(painted, "Relume Light").on


def test_the_name_of_a_new_light_is_free(painted):
    add_quad(painted, "Relume Light")
    solve(painted, added=[light("Relume Light"), light("Relume Light")])
    names = [state["name"] for state in looks.active_look(painted).look().lights]
    assert names == ["Relume Light.001", "Relume Light.002"]
    bpy.ops.relume.apply_solved()
    assert all(painted.objects[name].type == "LIGHT" for name in names)


def test_what_cannot_be_written_is_refused_and_no_light_is_made(painted):
    solve(painted, changed=[light("Key", "AREA")], added=[light("Relume Light")])
    bpy.data.objects["Key"].data.driver_add("energy")
    before = state_of(painted)
    with pytest.raises(RuntimeError, match="Nothing was written: light 'Key' has a driver on its energy"):
        bpy.ops.relume.apply_solved()
    with pytest.raises(RefusedError):
        results.apply(painted, looks.active_look(painted))
    assert state_of(painted) == before and "Relume" not in bpy.data.collections


def test_a_new_light_of_an_unknown_type_is_refused(painted):
    solve(painted, added=[light("Relume Light", "LASER")])
    with pytest.raises(RuntimeError, match="cannot be of type 'LASER'"):
        bpy.ops.relume.apply_solved()
    assert "Relume Light" not in bpy.data.objects


def test_solved_looks_pass_through_files(painted, tmp_path):
    solve(painted, added=[light("Relume Light")])
    looks.export_file(looks.active_look(painted).look(), tmp_path / "solved.json")
    read = from_json((tmp_path / "solved.json").read_text())
    assert read.lights[0]["added"] is True
    assert looks.restore(painted, read, lights=True) is not None and "Relume Light" in painted.objects


@pytest.fixture
def solved_world(lit_by_two, request):
    """A world of the bake that was solved with a light, not applied yet."""
    add_world(lit_by_two)
    painted = request.getfixturevalue("painted")
    found, job = begin(painted)
    job.answer(changed=[light("Key", "AREA")], world=[0.5, 0.25, 0.25])
    finish(found)
    return painted


def light_of_world(scene):
    """Radiance of the Background node of a world."""
    inputs = scene.world.node_tree.nodes["Background"].inputs
    return np.array(inputs["Color"].default_value[:3]) * inputs["Strength"].default_value


def test_a_solved_world_is_in_its_row_and_that_is_said(solved_world):
    assert results.apply(solved_world, looks.active_look(solved_world)) == [results.WORLD_STAYS]
    assert np.allclose(row(solved_world, "World", WORLD).values().gain(), [0.5, 0.25, 0.25])
    assert json.loads(solved_world.relume_solve.report)["notes"] == [results.WORLD_STAYS], "the panel says so, too"


def test_apply_to_lights_writes_a_solved_world(solved_world):
    before = light_of_world(solved_world)
    bpy.ops.relume.apply_solved()
    bpy.ops.relume.apply_to_lights()
    assert np.allclose(light_of_world(solved_world), before * [0.5, 0.25, 0.25])
    assert row(solved_world, "World", WORLD).values().gain() == [1.0, 1.0, 1.0]


def test_a_solved_look_is_the_same_however_often_it_is_applied(solved_world):
    before = light_of_world(solved_world)
    for _ in range(2):
        bpy.ops.relume.apply_solved()
    assert np.array_equal(light_of_world(solved_world), before)
    assert np.allclose(row(solved_world, "World", WORLD).values().gain(), [0.5, 0.25, 0.25])
    assert json.loads(solved_world.relume_solve.report)["notes"] == [results.WORLD_STAYS]


def test_nothing_is_said_of_a_world_that_was_not_solved(painted):
    painted.world = bpy.data.worlds.new("Sky")
    rows.sync(painted)
    solve(painted, changed=[light("Key", "AREA")])
    assert results.apply(painted, looks.active_look(painted)) == []
