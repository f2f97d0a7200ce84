"""The lock of a row says what solving leaves alone, for the light as a whole and for each of its parameters."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest
from solve_steps import begin

from addon.core.rows import GROUP, STATIC, WORLD
from addon.core.solve import SolveError
from addon.engine.solve.request import free_parameters
from addon.live import rows
from addon.ui import mixer
from addon.ui.solve import locks
from helpers import add_light, instance_linked_light, row, update

PARAMETERS = ["position", "direction", "size", "color", "strength"]
"""Parameters of an area light."""


@pytest.fixture
def sky(painted):
    """With a world."""
    painted.world = bpy.data.worlds.new("Sky")
    rows.sync(painted)
    return painted


def lock_of(scene, item):
    """The button of the lock in a line of the mixer: what it sets and its icon; None if there is none."""
    layout = MagicMock()
    locks.draw_lock(layout, scene, item)
    calls = layout.row.return_value.prop.call_args_list
    return (*calls[0].args, calls[0].kwargs["icon"]) if calls else None


def parameters_of(scene, item):
    """The names of what can be locked where the row is chosen, and whether it can be pressed."""
    layout = MagicMock()
    locks.draw_parameters(layout, scene, item)
    grid = layout.grid_flow.return_value
    return [call.args[1] for call in grid.prop.call_args_list], grid.enabled


def test_the_lock_of_a_row_tells_three_states(painted):
    key = row(painted, "Key")
    assert lock_of(painted, key) == (key.locks, "locked", locks.PARTLY), "a place is locked at first"
    for move in PARAMETERS:
        setattr(key.locks, move, True)
    assert lock_of(painted, key)[2] == "UNLOCKED", "an area light has no cone"
    key.locks.locked = True
    assert lock_of(painted, key)[2] == "LOCKED"


def test_a_locked_light_is_not_solved_and_keeps_what_was_free_of_it(painted):
    key = row(painted, "Key").locks
    key.position, key.color, key.locked = True, False, True
    found, job = begin(painted)
    assert list(job.request["free"]) == ["Fill"]
    found.cancel()
    key.locked = False
    assert free_parameters(painted, ["Key"])[0]["Key"] == ["position", "strength"]


def test_a_light_of_which_everything_is_locked_is_locked(painted):
    key = row(painted, "Key").locks
    key.color = key.strength = False
    assert key.locked and lock_of(painted, row(painted, "Key"))[2] == "LOCKED"
    assert parameters_of(painted, row(painted, "Key")) == (PARAMETERS, True), "they can be unlocked one by one"
    key.locked = False
    assert free_parameters(painted, ["Key"])[0]["Key"] == ["color", "strength"], "what is free at first"


def test_parameters_of_a_locked_light_wait_for_its_lock(painted):
    row(painted, "Key").locks.locked = True
    assert parameters_of(painted, row(painted, "Key")) == (PARAMETERS, False)


def test_all_lights_locked_leaves_nothing_to_solve(painted):
    for name in ("Key", "Fill"):
        row(painted, name).locks.locked = True
    with pytest.raises(SolveError, match="unlock something of a light"):
        begin(painted)


def test_the_world_has_a_lock_too(sky):
    item, settings = row(sky, "World", WORLD), sky.relume_solve
    assert lock_of(sky, item) == (settings, "world_locked", "LOCKED")
    settings.world_locked = False
    assert lock_of(sky, item)[2] == "UNLOCKED"
    assert free_parameters(sky, [])[0] == {"world": ["color", "strength"]}
    settings.world_color = False
    assert lock_of(sky, item)[2] == locks.PARTLY
    assert parameters_of(sky, item) == (["world_color", "world_strength"], True)
    settings.world_locked = True
    assert free_parameters(sky, [])[0] == {"world": []}


def test_what_cannot_be_solved_has_no_lock(painted):
    item = row(painted, "Emissive Materials", STATIC)
    assert lock_of(painted, item) is None and parameters_of(painted, item)[0] == []


@pytest.fixture
def grouped(painted):
    """Key and Fill in a collection inside of another, beside a Rim that is in none."""
    outer, inner = (bpy.data.collections.new(name) for name in ("Set", "Set Lights"))
    painted.collection.children.link(outer)
    outer.children.link(inner)
    for name in ("Key", "Fill"):
        inner.objects.link(bpy.data.objects[name])
        painted.collection.objects.unlink(bpy.data.objects[name])
    add_light(painted, "POINT", "Rim")
    update()
    rows.sync(painted)
    return painted


def group_lock_of(scene, name):
    """Icon of the lock of a group, and whether it can be pressed."""
    layout = MagicMock()
    locks.draw_lock(layout, scene, row(scene, name, GROUP))
    cell = layout.row.return_value
    return cell.operator.call_args.kwargs["icon"], cell.enabled


def test_the_lock_of_a_group_is_that_of_all_its_lights(grouped):
    assert group_lock_of(grouped, "Set") == (locks.PARTLY, True), "places are locked at first"
    assert bpy.ops.relume.lock_group(group="Set") == {"FINISHED"}
    assert [row(grouped, name).locks.locked for name in ("Key", "Fill", "Rim")] == [True, True, False]
    assert group_lock_of(grouped, "Set") == group_lock_of(grouped, "Set Lights") == ("LOCKED", True)
    row(grouped, "Fill").locks.locked = False
    assert group_lock_of(grouped, "Set") == (locks.PARTLY, True)
    bpy.ops.relume.lock_group(group="Set")
    assert row(grouped, "Fill").locks.locked, "one that is open closes with the others"
    bpy.ops.relume.lock_group(group="Set Lights")
    assert not row(grouped, "Key").locks.locked and not row(grouped, "Fill").locks.locked
    for name in ("Key", "Fill"):
        for move in PARAMETERS:
            setattr(row(grouped, name).locks, move, True)
    assert group_lock_of(grouped, "Set") == ("UNLOCKED", True)


def test_a_group_of_linked_lights_has_a_lock_that_cannot_be_pressed(painted, tmp_path):
    instance_linked_light(painted, tmp_path)
    update()
    rows.sync(painted)
    (group,) = (item for item in rows.present_rows(painted) if item.kind == GROUP)
    assert group_lock_of(painted, group.name) == ("LOCKED", False)


def test_all_lights_at_once_leaves_out_what_a_light_does_not_have(painted):
    bpy.ops.relume.lock_all(move="direction")
    assert row(painted, "Key").locks.direction and not row(painted, "Fill").locks.direction, "a point light has none"


@pytest.mark.parametrize("width", [250, 1000])
def test_every_line_has_its_lock(painted, monkeypatch, width):
    drawn = []
    monkeypatch.setattr(locks, "draw_lock", lambda _layout, _scene, item: drawn.append(item.name))
    places = {"region": SimpleNamespace(width=width), "preferences": bpy.context.preferences}
    for item in painted.relume_mix.rows:
        context = SimpleNamespace(scene=painted, **places)
        mixer.RELUME_UL_rows.draw_item(SimpleNamespace(), context, MagicMock(), painted, item, 0, painted, "")
    assert drawn == [item.name for item in painted.relume_mix.rows]
