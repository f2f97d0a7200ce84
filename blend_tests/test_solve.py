"""Solving asks for what was painted and what is unlocked, and changes nothing on the way."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from solve_steps import LINE, begin, finish, state_of, target_image

import addon
from addon.core.solve import SolveError
from addon.engine.shot import shot
from addon.engine.solve import solving
from addon.engine.solve.request import free_parameters
from addon.ui import looks
from addon.ui.solve import operators, panel
from fake_live import FakeLive
from fake_solve import FakeJob, light
from helpers import add, row, update


def test_the_request_has_the_picture_the_locks_and_the_goals(painted):
    row(painted, "Key").exposure = 1.0
    row(painted, "Key").locks.position = True
    row(painted, "Fill").locks.color = False
    settings = painted.relume_solve
    settings.add_count, settings.add_type, settings.keep_rest, settings.remove = 2, "area", 0.25, True
    found, job = begin(painted)
    request = job.request
    assert [light["name"] for light in request["lights"]] == ["Key", "Fill"]
    assert request["gains"] == {"Key": [2.0] * 3, "Fill": [1.0] * 3}
    assert request["free"] == {"Key": ["position", "strength"], "Fill": ["strength"]}, "no goal is about colour"
    assert request["add"] == {"count": 2, "type": "area"} and request["remove"] is True
    assert request["keep_rest"] == 0.25 and (request["starts"], request["steps"]) == (4, 300)
    assert request["stay"] == 0.0 and "bounds" not in request
    (goal,) = request["goals"]
    assert goal["goal"] == "brighter" and goal["stops"] == 1.0
    assert goal["where"]["strokes"][0]["points"] == [[0.2, 0.5, 1.0], [0.8, 0.5, 1.0]]
    assert job.folders == [str(shot.of(painted).folder)]
    found.cancel()


def test_colours_are_free_where_a_goal_is_about_colour(painted):
    bpy.ops.relume.scribble(points=LINE, goal="cooler", amount=40.0)
    found, job = begin(painted)
    assert job.request["free"] == {"Key": ["color", "strength"], "Fill": ["color", "strength"]}
    found.cancel()


def test_strength_and_colour_are_free_at_first_and_the_world_is_not(painted):
    painted.world = bpy.data.worlds.new("Sky")
    assert free_parameters(painted, ["Key", "Fill"]) == (
        {"Key": ["color", "strength"], "Fill": ["color", "strength"], "world": []},
        [],
    )
    painted.relume_solve.world_strength = True
    assert free_parameters(painted, [])[0] == {"world": ["strength"]}


def test_a_type_of_light_is_not_asked_to_change_what_it_does_not_have(painted):
    for name in ("Key", "Fill"):
        for move in ("position", "direction", "size", "cone"):
            setattr(row(painted, name).locks, move, True)
    free = free_parameters(painted, ["Key", "Fill"])[0]
    assert free["Key"] == ["position", "direction", "size", "color", "strength"]
    assert free["Fill"] == ["position", "size", "color", "strength"]


def driven(_scene):
    bpy.data.objects["Key"].data.driver_add("energy")
    return ["color"], "light 'Key' has a driver on its energy: that stays as it is"


def constrained(scene):
    bpy.data.objects["Key"].constraints.new("TRACK_TO").name = "Aim"
    row(scene, "Key").locks.direction = True
    return ["color", "strength"], "light 'Key' is placed by its constraint 'Aim': that stays as it is"


def shared(scene):
    bpy.data.objects["Fill"].data = bpy.data.objects["Key"].data
    row(scene, "Key").locks.position = True
    return ["position"], "light 'Key' shares its data 'Key' with other lights: that stays as it is"


def fixture(scene):
    arm = add(scene, "Arm", None)
    shade = add(scene, "Shade", bpy.data.meshes.new("Shade"))
    arm.parent, shade.parent = bpy.data.objects["Key"], arm
    row(scene, "Key").locks.position = True
    says = "light 'Key' carries 'Shade', which would move in the scene, but not in the bake: that stays as it is"
    return ["color", "strength"], says


def hung(scene):
    fill = bpy.data.objects["Fill"]
    fill.parent = bpy.data.objects["Key"]
    fill.keyframe_insert("location")
    row(scene, "Key").locks.direction = True
    return ["color", "strength"], "light 'Key' carries 'Fill', which has animation on its location: that stays as it is"


@pytest.mark.parametrize("spoil", [driven, constrained, shared, fixture, hung])
def test_what_could_not_be_written_stays_locked_and_is_said(painted, spoil):
    wanted, says = spoil(painted)
    free, notes = free_parameters(painted, ["Key", "Fill"])
    assert free["Key"] == wanted and says in notes


def test_what_hangs_on_a_light_and_does_no_harm_locks_nothing(painted):
    helper = add(painted, "Helper", bpy.data.meshes.new("Helper"))
    helper.hide_render = True
    for child in (helper, add(painted, "Arm", None), bpy.data.objects["Fill"]):
        child.parent = bpy.data.objects["Key"]
    row(painted, "Key").locks.position = True
    assert free_parameters(painted, ["Key"]) == ({"Key": ["position", "color", "strength"], "world": []}, [])


def test_lights_shown_by_instances_stay_locked(painted):
    """Even by a single one: its place is not the light's own."""
    rig = bpy.data.collections.new("Rig")
    rig.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    empty = add(painted, "Rig", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", rig
    update()
    free, notes = free_parameters(painted, ["Key", "Bulb"])
    assert free["Bulb"] == [] and free["Key"] and "light 'Bulb' is shown by instances: that stays as it is" in notes


def test_what_is_switched_off_stays_off(painted):
    row(painted, "Fill").on = False
    found, job = begin(painted)
    assert list(job.request["free"]) == ["Key"]
    found.cancel()


def test_locks_follow_their_light_and_all_can_be_switched_at_once(painted):
    row(painted, "Key").locks.size = True
    bpy.data.objects["Key"].name = "Hauptlicht"
    update()
    assert row(painted, "Hauptlicht").locks.size
    for free in (False, True):
        assert bpy.ops.relume.lock_all(move="size") == {"FINISHED"}
        assert all(row(painted, name).locks.size == free for name in ("Hauptlicht", "Fill"))


def test_lights_can_be_held_near_and_within_a_box(painted):
    settings = painted.relume_solve
    box = settings.box = add(painted, "Box", bpy.data.objects["Plane"].data)
    box.location, box.rotation_euler, box.scale = (1.0, 2.0, 3.0), (np.pi / 2, 0.0, 0.0), (2.0, 1.0, 1.0)
    update()
    with pytest.raises(SolveError, match="'Box' is flat, so no light can be within it"):
        begin(painted)
    box.data = bpy.data.meshes.new("Box")
    box.data.from_pydata([(-1, -1, -1), (1, 1, 0.5)], [], [])
    update()
    settings.stay = 0.5
    found, job = begin(painted)
    assert job.request["stay"] == 0.5
    assert np.allclose(job.request["bounds"]["min"], (-1.0, 1.5, 2.0), atol=1e-5)
    assert np.allclose(job.request["bounds"]["max"], (3.0, 3.0, 4.0), atol=1e-5)
    found.cancel()


def test_strength_and_turning_are_held_within_what_the_panel_says(painted):
    settings, key, fill = painted.relume_solve, row(painted, "Key").locks, row(painted, "Fill").locks
    settings.darker, settings.turn, key.brighter = 2.0, np.radians(30.0), 3.0
    found, job = begin(painted)
    assert not {"bounds", "each"} & set(job.request), "limits that are off"
    found.cancel()
    FakeJob.made.clear()
    settings.limit_strength = settings.limit_turn = settings.limit_tint = True
    settings.tint, fill.limit_tint, fill.tint = 1.5, True, 0.25
    key.limit_strength, key.darker, key.brighter = True, 0.0, 0.5
    fill.limit_turn, fill.turn, fill.own_stay, fill.stay = True, 0.0, True, 0.25
    box = fill.box = add(painted, "Box", bpy.data.meshes.new("Box"))
    box.data.from_pydata([(-1, -1, -1), (1, 1, 0.5)], [], [])
    update()
    found, job = begin(painted)
    assert job.request["bounds"]["stops"] == [-2.0, 1.0] and job.request["stay"] == 0.0
    assert job.request["bounds"]["degrees"] == pytest.approx(30.0)
    assert job.request["bounds"]["tint"] == 1.5
    assert job.request["each"] == {
        "Key": {"bounds": {"stops": [0.0, 0.5]}},
        "Fill": {
            "bounds": {"min": [-1.0, -1.0, -1.0], "max": [1.0, 1.0, 0.5], "tint": 0.25, "degrees": 0.0},
            "stay": 0.25,
        },
    }
    found.cancel()


def test_the_panel_shows_the_numbers_of_limits_that_are_on(painted):
    painted.relume_mix.active = list(painted.relume_mix.rows).index(row(painted, "Key"))
    key = row(painted, "Key").locks

    def shown():
        layout = MagicMock()
        layout.row.return_value = layout
        limits_panel = panel.RELUME_PT_solve_own_limits
        limits_panel.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=painted))
        assert all(call.args[0] == key for call in layout.prop.call_args_list)
        return [call.args[1] for call in layout.prop.call_args_list]

    area = ["limit_strength", "limit_tint", "limit_turn", "limit_size"]
    assert shown() == ["box", *area, "own_stay", "stay"]
    key.limit_strength = key.limit_tint = key.limit_turn = key.limit_size = True
    turn, size = ["limit_turn", "turn"], ["limit_size", "smallest", "largest"]
    strength = ["limit_strength", "darker", "brighter", "limit_tint", "tint"]
    assert shown() == ["box", *strength, *turn, *size, "own_stay", "stay"]
    key.limit_sun = key.limit_cone = True
    cone = ["limit_cone", "cone_least", "cone_most"]
    for kind, wanted in {
        "POINT": ["box", *strength, *size],
        "SPOT": ["box", *strength, *turn, *size, *cone],
        "SUN": [*strength, *turn, "limit_sun", "sun_least", "sun_most"],
    }.items():
        bpy.data.lights["Key"].type = kind
        assert shown() == [*wanted, "own_stay", "stay"], kind


def test_sizes_and_angles_are_held_within_what_the_panel_says(painted):
    settings, key = painted.relume_solve, row(painted, "Key").locks
    settings.limit_size, settings.smallest, settings.largest = True, 0.125, 0.5
    settings.limit_sun, settings.sun_least, settings.sun_most = True, np.radians(1.0), np.radians(4.0)
    key.limit_cone, key.cone_least, key.cone_most = True, np.radians(30.0), np.radians(60.0)
    found, job = begin(painted)
    bounds = job.request["bounds"]
    assert set(bounds) == {"size", "sun"} and bounds["size"] == [0.125, 0.5]
    assert np.degrees(bounds["sun"]) == pytest.approx([0.5, 2.0]), "half of what Blender shows"
    assert np.degrees(job.request["each"]["Key"]["bounds"]["cone"]) == pytest.approx([15.0, 30.0])
    found.cancel()


@pytest.mark.parametrize(
    ("switch", "low", "high", "says"),
    [
        ("limit_size", "smallest", "largest", "limits of the size leave nothing"),
        ("limit_sun", "sun_least", "sun_most", "limits of the angle of a sun leave nothing"),
        ("limit_cone", "cone_least", "cone_most", "limits of the cone of a spot leave nothing"),
    ],
)
def test_a_range_that_holds_nothing_is_said(painted, switch, low, high, says):
    settings = painted.relume_solve
    setattr(settings, switch, True)
    setattr(settings, low, getattr(settings, high))
    with pytest.raises(SolveError, match=says):
        begin(painted)


def test_limits_of_a_light_that_stays_are_not_asked_for(painted):
    row(painted, "Fill").on, row(painted, "Fill").locks.limit_turn = False, True
    found, job = begin(painted)
    assert list(job.request["free"]) == ["Key"] and "each" not in job.request
    found.cancel()


def test_places_become_goals_with_their_masks(baked):
    settings = baked.relume_solve
    settings.meaning, settings.mireds = "warmer", 40.0
    assert bpy.ops.relume.draw_rectangle(rectangle=(0.1, 0.2, 0.5, 0.6), goal="warmer") == {"FINISHED"}
    bpy.ops.relume.add_region(kind="OBJECT")
    settings.regions[1].object = bpy.data.objects["Plane"]
    settings.regions[1].goal = "keep"
    bpy.ops.relume.add_region(kind="MASK")
    mask = settings.regions[2].image = bpy.data.images.new("Mask", 128, 96)
    mask.pixels.foreach_set(np.ones(128 * 96 * 4, np.float32))
    found, job = begin(baked)
    first, second, third = job.request["goals"]
    assert first["goal"] == "warmer" and first["mireds"] == 40.0
    assert np.allclose(first["where"]["rectangle"], [0.1, 0.2, 0.5, 0.6])
    assert second == {"goal": "keep", "where": {"mask": "mask 2"}} and third["where"] == {"mask": "mask 3"}
    assert job.images["mask 2"].shape == job.images["mask 3"].shape == (48, 64, 1)
    assert 0.1 < job.images["mask 2"].mean() < 0.9 and job.images["mask 3"].min() == 1.0
    found.cancel()


def test_places_are_taken_away(baked):
    settings = baked.relume_solve
    assert not bpy.ops.relume.remove_region.poll()
    for kind in ("OBJECT", "MASK", "MATERIAL"):
        bpy.ops.relume.add_region(kind=kind)
    settings.region = 1
    assert bpy.ops.relume.remove_region() == {"FINISHED"}
    assert [(it.kind, settings.region) for it in settings.regions] == [("OBJECT", 1), ("MATERIAL", 1)]
    bpy.ops.relume.remove_region()
    assert [(it.kind, settings.region) for it in settings.regions] == [("OBJECT", 0)]
    bpy.ops.relume.remove_region()
    assert not settings.regions and settings.region == 0


def test_a_target_goes_along_as_light(baked):
    baked.view_settings.view_transform = "Standard"
    settings = baked.relume_solve
    settings.target, settings.target_exposure = target_image((128, 96)), True
    found, job = begin(baked)
    assert job.request["goals"] == [{"goal": "target", "image": "target", "exposure_invariant": True, "weight": 1.0}]
    assert job.images["target"].shape == (48, 64, 3) and np.allclose(job.images["target"], 0.216, atol=3e-3)
    assert not found.notes
    found.cancel()


@pytest.mark.parametrize(
    ("kind", "name", "share"),
    [
        ("RECTANGLE", None, None),
        ("MASK", "image", 0.5),
        # Two metres at five of a 50 mm lens on 36 mm film, of 4 to 3.
        ("OBJECT", "object", 4.0 / (3.6 * 2.7)),
        *(
            pytest.param(kind, name, 4.0 / (3.6 * 2.7), marks=pytest.mark.slow)
            for kind, name in (("MATERIAL", "material"), ("OBJECT_INDEX", "index"), ("MATERIAL_INDEX", "index"))
        ),
    ],
)
def test_a_target_can_count_in_a_place_alone(baked, kind, name, share):
    plane, material = bpy.data.objects["Plane"], bpy.data.materials.new("Clay")
    plane.data.materials.append(material)
    plane.pass_index = material.pass_index = 7
    mask = bpy.data.images.new("Left", 128, 96)
    mask.pixels.foreach_set(np.repeat(np.tile(np.arange(128) < 64, 96), 4).astype(np.float32))
    settings = baked.relume_solve
    settings.target = target_image((128, 96))
    settings.target_place.kind = kind
    if name is not None:
        values = {"image": mask, "object": plane, "material": material, "index": 7}
        setattr(settings.target_place, name, values[name])
    update()
    found, job = begin(baked)
    (goal,) = job.request["goals"]
    if name is None:
        assert np.allclose(goal["where"]["rectangle"], [0.25, 0.25, 0.75, 0.75]) and set(job.images) == {"target"}
    else:
        assert goal["goal"] == "target" and goal["where"] == {"mask": "mask of the target"}
        assert job.images["mask of the target"].shape == (48, 64, 1)
        assert job.images["mask of the target"].mean() == pytest.approx(share, rel=0.05)
    found.cancel()


def test_the_rectangle_of_a_target_is_drawn(baked):
    settings = baked.relume_solve
    assert bpy.ops.relume.draw_rectangle(rectangle=(0.1, 0.2, 0.5, 0.6), of_target=True) == {"FINISHED"}
    assert settings.target_place.kind == "RECTANGLE" and len(settings.regions) == 0
    assert np.allclose(settings.target_place.rectangle, (0.1, 0.2, 0.5, 0.6))


def test_a_doubtful_reading_of_the_target_is_said(baked):
    baked.view_settings.view_transform, baked.view_settings.look = "AgX", "AgX - Punchy"
    baked.relume_solve.target = target_image()
    found, _job = begin(baked)
    assert any("cannot be undone" in note for note in found.notes)
    found.cancel()


def test_previews_go_to_the_picture_and_never_to_lights(painted):
    before = state_of(painted)
    found, job = begin(painted)
    job.reports.append({"stage": "optimise", "done": 30, "total": 100, "remaining_s": 65.0})
    lights = {"format": "relume-lights", "version": 1, "lights": [{"name": "Key"}, {"name": "New 1"}]}
    job.previews.append({"lights": lights, "world": [0.5, 0.25, 0.125]})
    assert found.step() and found.progress == (0.3, "Solving, 30 %, 1:05 left")
    asked = FakeLive.made[-1].requests[-1]
    assert asked["interactive"] and asked["lights"] == lights and asked["gains"] == {}
    assert asked["world"] == [0.5, 0.25, 0.125]
    assert state_of(painted) == before
    found.cancel()
    assert job.is_cancelled and solving.running(painted) is None
    asked = FakeLive.made[-1].requests[-1]
    assert not asked["interactive"] and [light["name"] for light in asked["lights"]] == ["Key", "Fill"]
    assert state_of(painted) == before and len(painted.relume_looks.items) == 0


def test_only_one_is_solved_at_a_time(painted):
    found, _job = begin(painted)
    with pytest.raises(SolveError, match="already"):
        operators.begin(painted)
    assert not operators.RELUME_OT_solve.poll(bpy.context)
    assert bpy.ops.relume.cancel_solve() == {"FINISHED"}
    assert found.shot.is_open and solving.running(painted) is None


def test_it_goes_on_while_another_scene_is_shown(painted):
    found, job = begin(painted)
    operator = SimpleNamespace(solving=found, shown=found.progress, next_words=float("inf"))
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    event = SimpleNamespace(type="TIMER", value="NOTHING")
    job.reports.append({"stage": "polish", "done": 1, "total": 2, "remaining_s": None})
    assert operators.RELUME_OT_solve.modal(operator, bpy.context, event) == {"PASS_THROUGH"}
    assert found.progress == (0.5, "Polishing, 50 %") and found.is_running
    found.cancel()
    assert not found.is_running


def test_objects_are_not_looked_for_in_another_scene(painted):
    bpy.ops.relume.add_region(kind="OBJECT")
    painted.relume_solve.regions[0].object = bpy.data.objects["Plane"]
    found = operators.begin(painted)
    bpy.context.window.scene = bpy.data.scenes.new("Other")
    with pytest.raises(SolveError, match="go back to it"):
        finish(found)
    assert not found.is_running


def test_a_failure_on_the_way_ends_it(painted):
    found, job = begin(painted)
    job.fail("the device\nwas lost")
    with pytest.raises(SolveError, match="the device was lost"):
        finish(found)
    assert solving.running(painted) is None and len(painted.relume_looks.items) == 0


@pytest.mark.parametrize(
    "end",
    [
        lambda: bpy.ops.wm.read_factory_settings(use_empty=True),
        lambda: (addon.unregister(), addon.register()),
        shot.close_all,
    ],
    ids=["another file", "disabled", "bake closed"],
)
def test_what_ends_the_shot_ends_solving(painted, end):
    found, job = begin(painted)
    end()
    with pytest.raises(SolveError, match="was closed"):
        found.step()
    assert job.is_cancelled and solving.running(bpy.context.scene) is None


def test_undo_on_the_way_does_no_harm(painted):
    bpy.ops.ed.undo_push(message="painted")
    bpy.data.objects["Key"].location.x = 5.0
    bpy.ops.ed.undo_push(message="moved")
    found, job = begin(painted)
    bpy.ops.ed.undo()
    job.answer(changed=[light("Key", "AREA", energy=7.0)])
    finish(found)
    scene = bpy.context.scene
    assert looks.active_look(scene).solved and scene.objects["Key"].data.energy == 100.0


def test_a_light_deleted_on_the_way_is_left_out_and_said(painted):
    found, job = begin(painted)
    bpy.data.objects.remove(bpy.data.objects["Fill"])
    update()
    job.answer(changed=[light("Key", "AREA"), light("Fill")])
    finish(found)
    assert "Light 'Fill' is gone: what was solved for it is left out" in found.notes
    assert [state["name"] for state in looks.active_look(painted).look().lights] == ["Key"]
