"""Several views show the shots of their own cameras live: one state of the lights, a picture for each camera."""

import json
from copy import copy
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import relume
from solve_steps import LINE, begin, finish
from test_shots import put_bake

from addon.engine.reading.scene import load_scene
from addon.engine.shot import listed_view, open_shots, shot, shot_list
from addon.engine.shot.options import options_of, remember_bake
from addon.export import trace_settings
from addon.live import follow, seen
from addon.live.scheduler import scheduler
from addon.ui.start import show_bake
from addon.viewport import overlay, views
from addon.viewport.overlay import Show
from fake_live import FakeLive
from fake_solve import FakeJob, light
from helpers import add_light, add_quad, settled, until, update


@pytest.fixture
def looks(monkeypatch):
    """Makes 3D views look through cameras: Blender without a window cannot split its one view."""

    def through(*cameras):
        found = [views.View(number, camera, True, "ViewLayer") for number, camera in enumerate(cameras)]
        monkeypatch.setattr(views, "through_cameras", lambda scene: [*found])
        seen._looked.clear()

    yield through
    seen.forget()


def add_cameras(scene):
    """Two cameras more, and a shot for each."""
    for name, right in (("Left", -0.6), ("Right", 0.6)):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        camera.location = (right, 0.0, 5.0)
        scene.collection.objects.link(camera)
    update()
    shot_list.add_cameras(scene)
    return [scene.objects[name] for name in ("Camera", "Left", "Right")]


@pytest.fixture
def three(scene, registered_for_all_files, looks, tmp_path):
    """Three shots with bakes, of which the first is current, and a fake native module."""
    add_quad(scene)
    scene.relume.folder = str(tmp_path / "bakes")
    cameras = add_cameras(scene)
    for found in shot_list.all_shots(scene):
        put_bake(found.folder, found.camera)
    show_bake(scene)
    looks(*cameras)
    return scene, cameras


def open_all():
    """Ticks until every view has its shot."""
    for _ in range(4):
        scheduler.tick()


def names():
    return [found.camera for found in shot.all_open()]


def test_views_open_their_shots_and_close_them(three, looks):
    scene, (camera, left, right) = three
    open_all()
    assert names() == ["Camera", "Left", "Right"] and shot.of(scene).camera == "Camera"
    assert [found.board for found in FakeLive.made].count(FakeLive.made[0].board) == 3, "they take turns"
    looks(camera, right, right)
    open_all()
    assert names() == ["Camera", "Right"], "two views of one camera share a picture"
    looks()
    open_all()
    assert names() == ["Camera"] and ("close",) in FakeLive.made[2].calls


def test_one_edit_asks_for_all_pictures_and_the_lights_are_read_once(three, monkeypatch):
    scene, _ = three
    open_all()
    assert len({id(found.lights) for found in shot.all_open()}) == 1
    before = [len(live.requests) for live in FakeLive.made]
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    scene.collection.objects.link(lamp)
    update()
    asked = [live.requests[-1] for live in FakeLive.made]
    assert all(len(live.requests) > count for live, count in zip(FakeLive.made, before, strict=True))
    assert asked[0] == asked[1] == asked[2] and asked[0]["interactive"]
    scheduler.settling[scene.session_uid] = 0.0
    scheduler.tick()
    assert not any(live.requests[-1]["interactive"] for live in FakeLive.made)


def test_the_current_shot_follows_no_drag_while_only_others_are_seen(three, looks):
    scene, (_, left, right) = three
    looks(left, right)
    open_all()
    count = len(FakeLive.made[0].requests)
    scheduler.request_picture(scene, interactive=True)
    bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "POINT"))
    assert len(FakeLive.made[0].requests) == count
    assert not shot.of(scene).is_seen
    scheduler.read_lights(scene)
    looks()
    open_all()
    assert shot.of(scene).is_seen


def test_choosing_a_shot_that_is_seen_changes_places(three):
    scene, _ = three
    open_all()
    left, made = open_shots.by_key(scene, "Left"), len(FakeLive.made)
    scene.relume_shots.active = 1
    assert shot.of(scene) is left and len(FakeLive.made) == made, "nothing is opened again"
    open_all()
    assert sorted(names()) == ["Camera", "Left", "Right"]
    follow.show(scene)
    assert shot.of(scene) is left


def test_a_shot_without_a_bake_is_named_in_its_view(three, looks):
    scene, (_, left, _right) = three
    (shot_list.all_shots(scene)[1].folder / "manifest.json").unlink()
    open_all()
    assert names() == ["Camera", "Right"]
    assert overlay.words_without_shot(scene, left).startswith("Shot 'Left' has no bake yet")
    put_bake(shot_list.all_shots(scene)[1].folder, "Left")
    seen._looked.clear()
    open_all()
    assert names() == ["Camera", "Right", "Left"] and listed_view.refusal(scene, left) == ""


def test_what_would_be_another_state_is_said_instead(three, looks):
    scene, (_, left, right) = three
    entries = scene.relume_shots.items
    entries[1].use_frame, entries[1].frame = True, 20
    scene.view_layers.new("Fog")
    entries[2].layer = "Fog"
    open_all()
    assert names() == ["Camera"]
    assert "is of frame 20" in listed_view.refusal(scene, left)
    assert "is of view layer 'Fog'" in listed_view.refusal(scene, right)
    scene.frame_set(20)
    seen._looked.clear()
    open_all()
    assert names() == ["Camera", "Left"]
    scene.frame_set(1)
    open_all()
    assert names() == ["Camera"], "its frame is no longer the present one"


def test_views_that_do_not_fit_in_memory_are_named(three, monkeypatch):
    scene, (_, left, right) = three
    monkeypatch.setattr(listed_view, "_bytes_of", lambda folder: listed_view.MOST_BYTES // 2)
    open_all()
    assert names() == ["Camera", "Left"]
    assert "does not fit in memory" in listed_view.refusal(scene, right)


def test_of_twelve_large_shots_those_are_shown_that_fit(scene, registered_for_all_files, looks, tmp_path, monkeypatch):
    scene.relume.folder = str(tmp_path / "bakes")
    for number in range(11):
        camera = bpy.data.objects.new(f"Camera {number}", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(camera)
    update()
    entries = shot_list.add_cameras(scene)
    cameras = [entry.camera for entry in entries]
    monkeypatch.setattr(listed_view, "MOST_BYTES", 32 * 2**30)
    size = (3840, 2160)
    for found in shot_list.all_shots(scene):
        put_bake(found.folder, found.camera, size)
    show_bake(scene)
    looks(*cameras)
    for _ in range(13):
        scheduler.tick()
    each = listed_view.PIXEL_BYTES * size[0] * size[1]
    room = listed_view.MOST_BYTES // each
    assert 0 < room < 12 and len(names()) == room
    refused = [listed_view.refusal(scene, camera) for camera in cameras[room:]]
    assert len(refused) == 12 - room and all("does not fit in memory" in words for words in refused)
    looks(*cameras[-room:])
    for _ in range(13):
        scheduler.tick()
    seen._looked.clear()
    for _ in range(13):
        scheduler.tick()
    assert {found.camera for found in open_shots.beside(scene)} == {camera.name for camera in cameras[-room:]}


def test_a_bake_that_cannot_be_opened_or_read_is_said_in_its_view(three, monkeypatch):
    scene, (_, left, _right) = three
    with monkeypatch.context() as broken:
        broken.setattr(FakeLive, "open", lambda self, train_seconds=0.0: (_ for _ in ()).throw(RuntimeError("damaged")))
        open_all()
        assert "cannot be shown: damaged" in listed_view.refusal(scene, left)
        assert names() == ["Camera"], "what could not be opened is closed"
    seen._looked.clear()
    open_all()
    FakeLive.made[-1].tell(state="failed", error="manifest.json is damaged")
    scheduler.tick()
    found = next(found for found in shot.all_open() if found.status.error)
    assert "manifest.json is damaged" in overlay.words_without_picture(found)


def test_cameras_are_renamed_and_deleted(three, looks):
    scene, (camera, left, right) = three
    open_all()
    left.name = "Hero"
    update()
    open_all()
    assert open_shots.showing(scene, left).camera == "Hero" and len(names()) == 3
    bpy.data.objects.remove(right)
    looks(camera, left)
    update()
    open_all()
    assert sorted(names()) == ["Camera", "Hero"]


def test_undo_and_another_file_leave_nothing_behind(three, looks, tmp_path):
    scene, _ = three
    open_all()
    scene.relume_shots.items.remove(2)
    open_all()
    assert names() == ["Camera", "Left"], "as after undo of adding a shot"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    assert shot.all_open() == [] and seen._attended is None


def step_of_undo(name):
    bpy.ops.ed.undo_push(message=name)


def test_undo_and_redo_of_choosing_a_shot_show_what_is_chosen(three, looks):
    scene, _ = three
    looks()
    step_of_undo("listed")
    scene.relume_shots.active = 1
    assert names() == ["Left"] and scene.camera.name == "Left"
    step_of_undo("chosen")
    bpy.ops.ed.undo()
    assert bpy.context.scene.camera.name == "Camera" and names() == ["Camera"]
    bpy.ops.ed.redo()
    assert bpy.context.scene.camera.name == "Left" and names() == ["Left"]


def test_undo_and_redo_of_a_list_keep_the_picture_that_is_shown(scene, registered_for_all_files, looks, tmp_path):
    add_quad(scene)
    scene.relume.folder = str(tmp_path / "bakes")
    update()
    put_bake(options_of(scene).folder)
    show_bake(scene)
    (found,) = shot.all_open()
    step_of_undo("shown")
    add_cameras(scene)
    assert shot.all_open() == [found] and found.key == "Camera", "nothing is opened anew"
    step_of_undo("listed")
    for _ in range(2):
        bpy.ops.ed.undo()
        assert len(bpy.context.scene.relume_shots.items) == 0
        assert shot.all_open() == [found] and found.key == ""
        bpy.ops.ed.redo()
        assert len(bpy.context.scene.relume_shots.items) == 3
        assert shot.all_open() == [found] and found.key == "Camera"
    scene = bpy.context.scene
    put_bake(shot_list.all_shots(scene)[1].folder, "Left")
    scene.relume_shots.active = 1
    assert names() == ["Left"]
    step_of_undo("chosen")
    bpy.ops.ed.undo_history(item=0)
    assert len(bpy.context.scene.relume_shots.items) == 0 and names() == ["Camera"]


def test_the_view_under_the_mouse_comes_first(three):
    scene, _ = three
    open_all()
    seen.note_area(SimpleNamespace(as_pointer=lambda: 2))
    scheduler.tick()
    assert ("attend",) in FakeLive.made[2].calls
    seen.note_area(SimpleNamespace(as_pointer=lambda: 77))
    scheduler.tick()
    assert FakeLive.made[2].calls.count(("attend",)) == 1, "elsewhere is nothing to come first"


def test_a_view_draws_the_picture_of_its_own_camera(three):
    scene, (_, left, _right) = three
    open_all()
    FakeLive.made[1].show(value=0.25)
    open_all()
    area = next(a for s in bpy.data.screens for a in s.areas if a.type == "VIEW_3D")
    space = area.spaces.active
    space.use_local_camera, space.camera = True, left
    space.region_3d.view_perspective = "CAMERA"
    region = next(region for region in area.regions if region.type == "WINDOW")
    what = overlay.what_to_show(scene, space, region, space.region_3d)
    assert isinstance(what, Show) and what.first is open_shots.by_key(scene, "Left").frame
    assert what.title.startswith("Left")


@pytest.fixture
def solving_three(three, monkeypatch):
    """A solve that has begun in the first of three shots that are seen, with a light that shines on the plane alone."""
    scene, _ = three
    monkeypatch.setattr(relume, "solve", FakeJob)
    FakeJob.made.clear()
    add_light(scene, "POINT", "Lamp", shadow_soft_size=0.2)
    update()
    open_all()
    for live in FakeLive.made:
        live.tell(samples=4, state="ready")
        live.show()
    open_all()
    assert bpy.ops.relume.scribble(points=LINE, goal="brighter", amount=1.0) == {"FINISHED"}
    return scene, *begin(scene)


def newest():
    """The newest request of each shot that was opened."""
    return [live.requests[-1] for live in FakeLive.made]


def test_all_views_follow_a_solve_and_then_show_the_present_lights_again(solving_three):
    scene, solve, job = solving_three
    lights = {"format": "relume-lights", "version": 1, "lights": [{"name": "Lamp"}, {"name": "New 1"}]}
    job.previews.append({"lights": lights, "world": [0.5, 0.25, 0.125]})
    assert solve.step()
    first, *others = newest()
    assert first["interactive"] and first["lights"] == lights and first["world"] == [0.5, 0.25, 0.125]
    assert others == [first, first]
    solve.cancel()
    assert [[found["name"] for found in asked["lights"]] for asked in newest()] == [["Lamp"]] * 3


def test_the_result_of_a_solve_is_in_all_views_before_it_is_a_look(solving_three):
    scene, solve, job = solving_three
    job.answer(changed=[light("Lamp")])
    while solve.progress != (1.0, "Making the picture"):
        assert solve.step()
    assert [asked["interactive"] for asked in newest()] == [False, True, True]
    assert [asked["lights"] for asked in newest()] == [job.result()["lights"]] * 3
    finish(solve, FakeLive.made[0])
    assert len(scene.relume_looks.items) == 2
    assert not any("format" in asked["lights"] for asked in newest()), "the present lights"


def test_a_view_follows_a_solve_by_what_its_own_bake_counts_and_was_of(solving_three, monkeypatch):
    scene, solve, job = solving_three
    left, right = open_shots.beside(scene)
    own = open_shots.of(scene)
    own.lights.receivers = ["Plane", "Ball", "Cone"]
    left.lights, right.lights = copy(own.lights), copy(own.lights)
    left.lights.receivers = ["Ball", "Plane", "Cone"]
    right.lights.view_layer = "Other"
    monkeypatch.setattr(own.changes, "world_gain", lambda: [2.0, 2.0, 2.0])
    monkeypatch.setattr(left.changes, "world_gain", lambda: [1.0, 1.0, 1.0])
    count = len(FakeLive.made[2].requests)
    linked = [{"name": "Lamp", "receivers": {"receivers": [1]}}]
    job.previews.append({"lights": {"lights": linked}, "world": [1.0, 0.5, 0.0]})
    assert solve.step()
    first, asked, _ = newest()
    assert first["lights"]["lights"] == linked and first["world"] == [1.0, 0.5, 0.0]
    assert asked["lights"]["lights"][0]["receivers"] == {"receivers": [0]}
    assert asked["world"] == [0.5, 0.25, 0.0]
    assert len(FakeLive.made[2].requests) == count, "of another view layer"


def bake_three(scene):
    """Cameras of three shots with bakes, of which the first is open."""
    cameras = add_cameras(scene)
    for entry, camera in zip(scene.relume_shots.items, cameras, strict=True):
        scene.camera = camera
        update()
        folder = options_of(scene, entry).folder
        relume.bake(load_scene(scene), folder, trace_settings(scene, lambda _: None) | {"samples": 16}).wait()
        remember_bake(scene, folder, entry.key)
    scene.camera = cameras[0]
    update()
    show_bake(scene)
    return cameras


def test_three_real_shots_follow_one_light_and_each_is_its_relight(studio, looks):
    looks(*bake_three(studio))
    until(studio, lambda _: len(shot.all_open()) == 3, "three shots")
    lamp = bpy.data.objects["Key"]
    for _ in range(5):
        lamp.location.x += 0.2
        update()
        scheduler.tick()
    until(studio, lambda _: all(map(settled, shot.all_open())), "all pictures")
    pictures = []
    for found in shot.all_open():
        text = json.dumps({"format": "relume-lights", "version": 1, "lights": scheduler.lights_of(studio, found)})
        expected = relume.Relighter(found.folder).relight(text)["combined"]
        assert np.abs(found.frame.image[::-1, :, :3] - expected).max() < 1e-5
        pictures.append(found.frame.image)
    assert min(np.abs(pictures[0] - other).mean() for other in pictures[1:]) > 1e-3
