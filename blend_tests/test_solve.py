"""Solving asks for what was painted, changes nothing, ends in a look, and is written when told to."""

import json

import bpy
import numpy as np
import pytest
import relume

import addon
from addon.apply.writable import RefusedError
from addon.core.looks import from_json
from addon.core.rows import GROUP, LIGHT, STATIC, WORLD, Row, freed, mix
from addon.core.solve import SolveError
from addon.engine import shot
from addon.ui import handlers, locks, looks, rows, solve_panel, solving, target
from addon.ui.start import start
from addon.viewport import compare as pairs
from fake_live import FakeLive
from fake_solve import FakeJob, light
from helpers import add_light, add_quad

LINE = "[[0.2, 0.5, 1.0], [0.8, 0.5, 1.0]]"


@pytest.fixture(autouse=True)
def registered(scene, monkeypatch):
    """The add-on, enabled, with a fake native module."""
    monkeypatch.setattr(relume, "Live", FakeLive)
    monkeypatch.setattr(relume, "solve", FakeJob, raising=False)
    FakeLive.made.clear()
    FakeJob.made.clear()
    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def lit(scene, tmp_path):
    """A key and a fill on a plane, with a folder to bake into."""
    add_quad(scene)
    add_light(scene, "AREA", "Key", location=(1, 2, 3), shape="DISK", size=0.5)
    add_light(scene, "POINT", "Fill", shadow_soft_size=0.2)
    scene.relume.folder = str(tmp_path / "bake")
    update()
    return scene


@pytest.fixture
def baked(lit):
    """With a picture."""
    start(lit)
    live = FakeLive.made[-1]
    live.tell(samples=4, state="ready")
    live.show()
    handlers.tick()
    return lit


@pytest.fixture
def painted(baked):
    """With a stroke."""
    assert bpy.ops.relume.scribble(points=LINE, goal="brighter", amount=1.0) == {"FINISHED"}
    return baked


def update():
    """What Blender does after every change."""
    bpy.context.view_layer.update()


def row(scene, name, kind=LIGHT):
    """The row of a name."""
    return next(row for row in rows.present_rows(scene) if (row.kind, row.name) == (kind, name))


def state_of(scene):
    """All that solving could write to."""
    return {
        obj.name: (
            obj.data.energy,
            tuple(obj.data.color),
            np.round(np.array(obj.matrix_world), 5).tolist(),
            obj.hide_render,
        )
        for obj in scene.objects
        if obj.type == "LIGHT"
    }


def begin(scene):
    """Begins, as far as the native module's work."""
    found = solving.begin(scene)
    while not FakeJob.made:
        found.step()
    return found, FakeJob.made[-1]


def finish(found, live=None):
    """Goes on to the end, with the picture of the result."""
    live = live or FakeLive.made[-1]
    before = len(live.requests)
    while found.step():
        if len(live.requests) > before:
            before = len(live.requests)
            live.show(serial=live.newest.serial + 1)
            handlers.tick()


# What is asked for


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
    assert locks.free(painted, ["Key", "Fill"]) == (
        {"Key": ["color", "strength"], "Fill": ["color", "strength"], "world": []},
        [],
    )
    painted.relume_solve.world_strength = True
    assert locks.free(painted, [])[0] == {"world": ["strength"]}


def test_a_type_of_light_is_not_asked_to_change_what_it_does_not_have(painted):
    for name in ("Key", "Fill"):
        for move in ("position", "direction", "size", "cone"):
            setattr(row(painted, name).locks, move, True)
    free = locks.free(painted, ["Key", "Fill"])[0]
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


@pytest.mark.parametrize("spoil", [driven, constrained, shared])
def test_what_could_not_be_written_stays_locked_and_is_said(painted, spoil):
    wanted, says = spoil(painted)
    free, notes = locks.free(painted, ["Key", "Fill"])
    assert free["Key"] == wanted and says in notes


def test_lights_shown_by_instances_stay_locked(painted):
    free, notes = locks.free(painted, ["Key", "Fill", "Fill#2"])
    assert free["Fill"] == [] and "light 'Fill' is shown several times, by instances: that stays as it is" in notes


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


def target_image(size=(64, 48), value=0.5):
    """An image data-block of one grey."""
    image = bpy.data.images.new("Painting", *size)
    pixels = np.full((size[1], size[0], 4), value, np.float32)
    pixels[..., 3] = 1.0
    image.pixels.foreach_set(pixels.reshape(-1))
    return image


def test_a_target_goes_along_as_light(baked):
    baked.view_settings.view_transform = "Standard"
    settings = baked.relume_solve
    settings.target, settings.target_exposure = target_image((128, 96)), True
    found, job = begin(baked)
    assert job.request["goals"] == [{"goal": "target", "image": "target", "exposure_invariant": True, "weight": 1.0}]
    assert job.images["target"].shape == (48, 64, 3) and np.allclose(job.images["target"], 0.216, atol=3e-3)
    assert not found.notes
    found.cancel()


def test_a_doubtful_reading_of_the_target_is_said(baked):
    baked.view_settings.view_transform, baked.view_settings.look = "AgX", "AgX - Punchy"
    baked.relume_solve.target = target_image()
    found, _job = begin(baked)
    assert any("cannot be undone" in note for note in found.notes)
    found.cancel()


# What keeps it from being solved


def no_bake(scene):
    shot.close_all()
    return "Press Start first"


def no_picture(scene):
    FakeLive.made[-1].tell(samples=0)
    handlers.tick()
    return "Wait for the first picture"


def no_goal(scene):
    bpy.ops.relume.clear_strokes()
    return "Say what the picture should do"


def all_erased(scene):
    bpy.ops.relume.scribble(points=LINE, goal="erase", radius=0.2)
    return "Say what the picture should do"


def nothing_free(scene):
    bpy.ops.relume.lock_all(move="strength")
    return "Nothing may change: unlock"


def black_target(scene):
    scene.relume_solve.target = target_image(value=0.0)
    return "'Painting' is all black"


def square_target(scene):
    scene.relume_solve.target = target_image((64, 64))
    return "'Painting' is 64 x 64 and the camera's frame 64 x 48"


def empty_mask(scene):
    bpy.ops.relume.add_region(kind="MASK")
    return "A place has no mask"


def no_object(scene):
    bpy.ops.relume.add_region(kind="OBJECT")
    return "A place has no object"


def unseen(scene):
    bpy.ops.relume.add_region(kind="OBJECT_INDEX")
    scene.relume_solve.regions[0].index = 99
    return "Not seen in the picture: object index 99"


def solver_refuses(scene):
    FakeJob.made.append(None)

    def refuse(*_arguments, **_options):
        raise ValueError("goal 1 has no place\nin the picture")

    relume.solve = refuse  # The fixture puts it back.
    return "goal 1 has no place in the picture"


@pytest.mark.parametrize(
    "spoil",
    [
        *(no_bake, no_picture, no_goal, all_erased, nothing_free, black_target, square_target, empty_mask, no_object),
        *(unseen, solver_refuses),
    ],
)
def test_what_cannot_be_solved_is_one_clear_line(painted, spoil):
    says = spoil(painted)
    before = state_of(painted)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.relume.solve()
    assert state_of(painted) == before and solving.running(painted) is None
    assert len(painted.relume_looks.items) == 0
    assert not [job for job in FakeJob.made if job is not None and not job.is_cancelled]


def test_a_target_that_does_not_fit_is_not_taken(baked, tmp_path):
    image = target_image((64, 64))
    image.filepath_raw, image.file_format = str(tmp_path / "square.png"), "PNG"
    image.save()
    with pytest.raises(RuntimeError, match="crop it to the same aspect"):
        bpy.ops.relume.load_target(filepath=str(tmp_path / "square.png"))
    (tmp_path / "broken.png").write_bytes(b"no picture")
    with pytest.raises(RuntimeError, match="broken.png"):
        bpy.ops.relume.load_target(filepath=str(tmp_path / "broken.png"))
    with pytest.raises(RuntimeError, match="cannot be opened"):
        bpy.ops.relume.load_target(filepath=str(tmp_path / "none.png"))
    assert baked.relume_solve.target is None
    with pytest.raises(RuntimeError, match="needs Blender's window"):
        bpy.ops.relume.paste_target()


def test_a_target_from_a_file_is_shown_beside_the_picture(baked, tmp_path):
    image = target_image((128, 96))
    image.filepath_raw, image.file_format = str(tmp_path / "painting.png"), "PNG"
    image.save()
    assert bpy.ops.relume.load_target(filepath=str(tmp_path / "painting.png")) == {"FINISHED"}
    assert bpy.ops.relume.show_target() == {"FINISHED"}
    pair = pairs.pair_of(baked)
    assert pair.a.image.shape == (48, 64, 4) and pair.b is None and pair.labels == ("Target", "Relit")
    assert bpy.ops.relume.clear_target() == {"FINISHED"} and baked.relume_solve.target is None


def test_the_size_of_targets_is_that_of_the_bake(baked):
    folder = shot.of(baked).folder
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps({"width": 640, "height": 480}))
    assert target.picture_size(baked) == (640, 480)
    (folder / "manifest.json").write_text("{")
    baked.render.resolution_percentage = 50
    assert target.picture_size(baked) == (32, 24)


# While it is solved


def test_previews_go_to_the_picture_and_never_to_lights(painted):
    before = state_of(painted)
    found, job = begin(painted)
    job.reports.append({"done": 30, "total": 100})
    job.previews.append({"format": "relume-lights", "version": 1, "lights": []})
    assert found.step() and found.progress == (0.3, "Solving, 30 %")
    asked = FakeLive.made[-1].requests[-1]
    assert asked["interactive"] and asked["lights"]["format"] == "relume-lights" and asked["gains"] == {}
    assert state_of(painted) == before
    found.cancel()
    assert job.is_cancelled and solving.running(painted) is None
    asked = FakeLive.made[-1].requests[-1]
    assert not asked["interactive"] and [light["name"] for light in asked["lights"]] == ["Key", "Fill"]
    assert state_of(painted) == before and len(painted.relume_looks.items) == 0


def test_only_one_is_solved_at_a_time(painted):
    found, _job = begin(painted)
    with pytest.raises(SolveError, match="already"):
        solving.begin(painted)
    assert not solve_panel.RELUME_OT_solve.poll(bpy.context)
    assert bpy.ops.relume.cancel_solve() == {"FINISHED"}
    assert found.shot.is_open and solving.running(painted) is None


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


# What comes of it


def solve(scene, **answer):
    """Solves to the end."""
    FakeJob.made.clear()
    found, job = begin(scene)
    job.answer(**answer)
    finish(found)
    return found


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
        solving.apply(painted, looks.active_look(painted))
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


# Rows of the look


def gains(found, memberships):
    """The mix of rows and groups in one list."""
    groups = [row for row in found if row.kind == GROUP]
    return mix([row for row in found if row.kind != GROUP], groups, memberships)


@pytest.mark.parametrize(
    ("key", "fill", "rig"),
    [
        (Row("Key", exposure=1.0), Row("Fill"), Row("Rig", GROUP, multiplier=0.5, color=(1.0, 0.5, 0.25))),
        (Row("Key"), Row("Fill", color=(0.5, 1.0, 1.0)), Row("Rig", GROUP, on=False)),
        (Row("Key"), Row("Fill", solo=True, use_kelvin=True, kelvin=3000.0), Row("Rig", GROUP, exposure=2.0)),
        (Row("Key", on=False), Row("Fill"), Row("Rig", GROUP, solo=True)),
        (Row("Key"), Row("Fill", multiplier=0.0), Row("Rig", GROUP)),
    ],
)
def test_rows_of_lights_that_were_not_solved_keep_their_gain(key, fill, rig):
    present = [key, fill, Row("Rim"), Row("World", WORLD, exposure=-1.0), Row("Emissive Materials", STATIC)]
    memberships = {"Key": ["Rig"], "Fill": ["Rig"]}
    before = mix(present, [rig], memberships)
    after = gains(freed(present, [rig], memberships, ["Key"]), memberships)
    assert after["gains"]["Key"] == [1.0, 1.0, 1.0]
    for name in ("Fill", "Rim"):
        assert np.allclose(after["gains"][name], before["gains"][name])
    assert after["world"] == before["world"] and after["static"] == before["static"]


def test_groups_that_reach_no_solved_light_stay():
    rig = Row("Rig", GROUP, exposure=1.0)
    assert rig in freed([Row("Key"), Row("Fill")], [rig], {"Fill": ["Rig"]}, ["Key"])


def test_a_solved_world_is_in_its_row(painted):
    painted.world = bpy.data.worlds.new("Sky")
    rows.sync(painted)
    found, job = begin(painted)
    job.answer(changed=[light("Key", "AREA")], world=[0.5, 0.25, 0.25])
    finish(found)
    bpy.ops.relume.apply_solved()
    assert np.allclose(row(painted, "World", WORLD).values().gain(), [0.5, 0.25, 0.25])
