"""Content of a 3D view: pictures, a hint, or nothing; and what the handlers do around it."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.phase import ShotPhase
from addon.engine.shot import shot
from addon.export import view_transform
from addon.ui.start import start
from addon.viewport import compare, handlers, light_marks, overlay, view_table
from addon.viewport.overlay import Show
from fake_live import FakeLive
from helpers import add_light


@pytest.fixture
def view(lit):
    """The arguments of `what_to_show` for a view through the camera of a started shot with a picture."""
    found = start(lit)
    FakeLive.made[-1].show()
    found.poll()
    area = next(a for s in bpy.data.screens for a in s.areas if a.type == "VIEW_3D")
    space = area.spaces.active
    space.use_local_camera = False
    space.region_3d.view_perspective = "CAMERA"
    region = next(region for region in area.regions if region.type == "WINDOW")
    yield SimpleNamespace(scene=lit, space=space, region=region, region_data=space.region_3d, shot=found)
    compare.clear(lit)
    view_table.clear()


def shown(view):
    return overlay.what_to_show(view.scene, view.space, view.region, view.region_data)


def picture(serial):
    return SimpleNamespace(serial=serial, scale=1, image=np.ones((4, 6, 4), np.float32))


def test_the_newest_frame_fills_the_cameras_frame(view):
    what = shown(view)
    assert what.first is what.second is view.shot.frame
    assert what.drawn == what.frame and what.mode == overlay.SINGLE and what.split == overlay.NEVER
    FakeLive.made[-1].show(serial=2)
    view.shot.poll()
    assert shown(view).first is view.shot.frame and view.shot.frame.serial == 2


def test_nothing_is_shown_where_relume_is_not_at_work(view):
    view.scene.relume_view.shown = False
    assert shown(view) is None
    view.scene.relume_view.shown = True
    view.region_data.view_perspective = "ORTHO"
    assert shown(view) is None, "no hints in views from the side"
    view.region_data.view_perspective = "CAMERA"
    view.shot.close()
    assert shown(view) is None


def test_a_view_that_is_not_the_baked_camera_says_so(view):
    view.region_data.view_perspective = "PERSP"
    assert shown(view) == "The relit picture is in the view of camera 'Camera'"
    view.region_data.view_perspective = "CAMERA"
    other = bpy.data.objects.new("Side", bpy.data.cameras.new("Side"))
    view.scene.collection.objects.link(other)
    view.scene.camera = other
    assert shown(view) == "No bake for camera 'Side', only for 'Camera'"
    view.scene.camera = None
    assert isinstance(shown(view), str)


def test_a_renamed_camera_is_the_same(view):
    assert isinstance(shown(view), Show)
    view.scene.camera.name = "Hero"
    assert isinstance(shown(view), Show)
    view.region_data.view_perspective = "PERSP"
    assert shown(view) == "The relit picture is in the view of camera 'Hero'"
    view.region_data.view_perspective = "CAMERA"
    other = bpy.data.objects.new("Camera", bpy.data.cameras.new("Side"))
    view.scene.collection.objects.link(other)
    view.scene.camera = other
    assert shown(view) == "No bake for camera 'Camera', only for 'Hero'", "not another one that has its old name"


def test_a_camera_that_was_deleted_and_made_again_is_known_by_its_name(view):
    assert isinstance(shown(view), Show)
    bpy.data.objects.remove(view.scene.camera)
    again = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    view.scene.collection.objects.link(again)
    view.scene.camera = again
    assert isinstance(shown(view), Show)


def test_before_the_first_picture_there_is_a_word(view):
    view.shot.frame = None
    assert shown(view) == "The first picture is on its way"
    view.shot.status = replace(view.shot.status, phase=ShotPhase.FAILED)
    assert shown(view) == "No picture yet"


def test_a_rebake_shows_the_picture_before_until_it_has_one(view):
    before = view.shot.frame
    view.shot = start(view.scene)
    assert view.shot.frame is None and shown(view).first is before
    view.shot.poll()
    assert shown(view).first is before
    FakeLive.made[-1].show()
    view.shot.poll()
    assert shown(view).first is view.shot.frame is not before


def test_a_rebake_that_was_given_up_has_no_picture(view):
    view.shot = start(view.scene)
    FakeLive.made[-1].tell(state="cancelled")
    view.shot.poll()
    assert shown(view) == "No picture yet"


def test_a_bake_of_another_camera_does_not_show_the_picture_before(view):
    other = bpy.data.objects.new("Side", bpy.data.cameras.new("Side"))
    view.scene.collection.objects.link(other)
    view.scene.camera = other
    start(view.scene)
    assert shown(view) == "The first picture is on its way"


def test_wipe_opacity_and_border_are_followed(view):
    settings, render = view.scene.relume_view, view.scene.render
    settings.opacity, settings.wipe, settings.wipe_position = 0.5, True, 0.25
    render.use_border, render.border_min_x = True, 0.5
    what = shown(view)
    assert what.opacity == 0.5
    assert what.split == pytest.approx(what.frame.left + what.frame.width / 4)
    assert what.drawn.left == pytest.approx(what.frame.left + what.frame.width / 2)


def test_two_frames_are_compared_in_every_mode(view):
    first, second = picture(7), picture(8)
    for mode in compare.MODES:
        compare.set_pair(view.scene, first, second, mode, ("Cycles", "Relume"))
        what = shown(view)
        expected = {"A": (first, first), "B": (second, second)}.get(mode, (first, second))
        assert (what.first, what.second) == expected
        assert what.mode == {"WIPE": overlay.SPLIT, "DIFFERENCE": overlay.DIFFERENCE}.get(mode, overlay.SINGLE)
        assert what.labels == (("Cycles", "Relume") if mode == "WIPE" else ("Relume", "View"))
    compare.set_pair(view.scene, first, None, "WIPE")
    assert shown(view).second is view.shot.frame, "the live picture stands for B"
    assert set(map(id, compare.frames())) == {id(first)}
    compare.clear(view.scene)
    assert shown(view).first is view.shot.frame


def test_lights_in_front_of_the_picture_are_marked(view):
    lights = [add_light(view.scene, "POINT", name=f"L{x}") for x in range(3)]
    bpy.context.view_layer.update()
    what = shown(view)
    # Camera space: in the middle, far to the side, behind; as the region's matrix sees them.
    world_from_clip = np.linalg.inv(np.array(view.region_data.perspective_matrix))
    frame = what.frame
    middle = np.array([frame.left + frame.right, frame.bottom + frame.top]) / what.region - 1.0
    for light, clip in zip(lights, ((*middle, 0.5, 1.0), (*(middle + 9.0), 0.5, 1.0)), strict=False):
        point = world_from_clip @ clip
        light.location = point[:3] / point[3]
    near, far = np.array(lights[0].location), view.region_data.view_matrix.inverted().translation
    lights[2].location = 2 * np.array(far) - near
    bpy.context.view_layer.update()
    places = light_marks.places_of(lights, view.region_data, what)
    expected = (frame.left + frame.width / 2, frame.bottom + frame.height / 2)
    assert places[0] == pytest.approx(expected, abs=0.5)
    assert np.isnan(places[1:]).all()
    assert light_marks.places_of([], view.region_data, what).shape == (0, 2)


def test_the_timer_completes_the_table_of_a_waiting_scene_and_ends(view, small_tables):
    view.scene.view_settings.view_transform = "AgX"
    handlers._waiting.add(view.scene.session_uid)
    assert handlers.bake_views() == handlers.NEXT_TURN_SECONDS
    assert view_table.of(view.scene) is None
    assert handlers.bake_views() is None
    assert view_table.is_complete(view.scene) and not handlers._waiting


def test_a_table_that_cannot_be_made_is_said_and_tried_again(view, small_tables, monkeypatch):
    view.scene.view_settings.view_transform = "AgX"
    handlers._waiting.add(view.scene.session_uid)

    def full(*_arguments):
        raise OSError("cannot write the view transform; check the free space: /full")

    with monkeypatch.context() as broken:
        broken.setattr(view_transform, "_write", full)
        handlers.bake_views()
        assert handlers.bake_views() == handlers.RETRY_SECONDS
        assert "free space" in handlers._trouble[view.scene.session_uid]
    assert handlers.bake_views() is None
    assert view_table.is_complete(view.scene) and not handlers._trouble


def test_scenes_that_are_gone_are_not_waited_for(view):
    handlers._waiting.add(-5)
    assert handlers.bake_views() is None
    assert not handlers._waiting


def test_another_file_forgets_what_was_compared(view):
    compare.set_pair(view.scene, picture(1), None, "A")
    handlers._forget()
    assert compare.pair_of(view.scene) is None and isinstance(shown(view), Show)
    assert shot.of(view.scene) is view.shot
