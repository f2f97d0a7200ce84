"""The list of shots: adding, following, folders, what is wrong, and copies of scenes."""

import json
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest

from addon.core.bake_folder import is_bake
from addon.engine.shot import shot, shot_list
from addon.engine.shot.checks import ProblemError, check_start
from addon.engine.shot.options import bake_folder, options_of, remember_bake, remembered_bake
from addon.export.current_shot import current_entry, current_size, entries
from addon.export.view_layer import render_layer
from addon.ui.shots import panel
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add_quad

pytestmark = pytest.mark.every_version


@pytest.fixture
def cameras(scene, registered_for_all_files):
    """Three cameras in the scene, the add-on with a fake native module."""
    add_quad(scene)
    for name in ("Close", "Top"):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        camera.location = (0.0, -1.0, 4.0)
        scene.collection.objects.link(camera)
    bpy.context.view_layer.update()
    return scene


def names(scene):
    """Names of the shots, in the order of the list."""
    return [entry.name for entry in entries(scene)]


def bind(scene, name, frame, camera):
    """A marker that a camera is bound to."""
    scene.timeline_markers.new(name, frame=frame).camera = bpy.data.objects[camera]


def put_bake(folder, camera="Camera", size=(0, 0)):
    """A folder that passes for a bake."""
    folder.mkdir(parents=True, exist_ok=True)
    about = {"scene_hash": "", "passes": [], "tile_size": 64, "camera": {"name": camera}}
    (folder / "manifest.json").write_text(json.dumps(about | dict(zip(("width", "height"), size, strict=True))))
    assert is_bake(folder)
    return folder


def test_without_a_list_a_scene_has_the_folder_that_it_always_had(cameras, tmp_path):
    before = bake_folder(cameras)
    assert [found.folder for found in shot_list.all_shots(cameras)] == [before] and entries(cameras) == []
    bpy.ops.relume.add_cameras()
    assert current_entry(cameras).name == "Camera" and bake_folder(cameras) == before, "its bake is found again"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    folders = [found.folder.name for found in shot_list.all_shots(cameras)]
    assert folders == ["file_Scene_Camera", "file_Scene_Close", "file_Scene_Top"]
    cameras.relume.folder = "//bakes"
    folders = [found.folder for found in shot_list.all_shots(cameras)]
    assert folders[1] == tmp_path / "bakes" / "Scene_Close"


def test_what_is_added_is_returned_as_it_lies_in_the_list(cameras):
    for number in range(12):
        camera = bpy.data.objects.new(f"More {number}", bpy.data.cameras.new("More"))
        cameras.collection.objects.link(camera)
        cameras.timeline_markers.new(f"Marker {number}", frame=number).camera = camera
    for add in (shot_list.add_from_markers, shot_list.add_cameras):
        before = len(entries(cameras))
        added = add(cameras)
        assert [it.as_pointer() for it in added] == [it.as_pointer() for it in entries(cameras)[before:]]


def test_cameras_are_added_once_and_only_those_of_the_scene(cameras):
    bpy.data.objects.new("Deleted", bpy.data.cameras.new("Deleted")).use_fake_user = True
    assert bpy.ops.relume.add_cameras() == {"FINISHED"}
    assert names(cameras) == ["Camera", "Close", "Top"]
    assert bpy.ops.relume.add_cameras() == {"CANCELLED"}
    assert names(cameras) == ["Camera", "Close", "Top"]


def test_markers_become_shots_of_their_frames(cameras):
    bind(cameras, "Second", 20, "Top")
    bind(cameras, "First", 5, "Close")
    cameras.timeline_markers.new("Beat", frame=9)
    assert bpy.ops.relume.add_from_markers() == {"FINISHED"}
    assert [(entry.name, entry.camera.name, entry.frame) for entry in entries(cameras)] == [
        ("First", "Close", 5),
        ("Second", "Top", 20),
    ]
    assert all(entry.use_frame for entry in entries(cameras))
    assert bpy.ops.relume.add_from_markers() == {"CANCELLED"}


def test_choosing_a_shot_makes_its_camera_and_frame_current(cameras):
    bind(cameras, "First", 5, "Close")
    bind(cameras, "Second", 20, "Top")
    bpy.ops.relume.add_from_markers()
    state = cameras.relume_shots
    state.active = 1
    assert (cameras.camera.name, cameras.frame_current) == ("Top", 20)
    assert current_entry(cameras).name == "Second"
    state.follow = False
    state.active = 0
    assert (cameras.camera.name, cameras.frame_current) == ("Top", 20)
    assert current_entry(cameras).name == "Second", "the shot of the camera that the scene has"
    cameras.frame_set(3)
    assert current_entry(cameras) is None, "no shot is of this frame"


def test_a_shot_has_its_own_quality_size_and_layer(cameras):
    bpy.ops.relume.add_cameras()
    cameras.view_layers.new("Hero")
    entry = entries(cameras)[0]
    assert options_of(cameras).samples == 64 and current_size(cameras) is None
    assert render_layer(cameras) == cameras.view_layers[0]
    entry.quality, entry.use_size, entry.width, entry.height, entry.layer = "DRAFT", True, 32, 20, "Hero"
    options = options_of(cameras)
    assert (options.samples, options.resolution, options.shot) == (16, (32, 20), "Camera")
    assert render_layer(cameras).name == "Hero" and current_size(cameras) == (32, 20)
    wanted = shot_list.arguments(shot_list.current(cameras))
    assert wanted == ["--camera", "Camera", "--layer", "Hero", "--resolution", "32x20"]
    evaluated = bpy.context.evaluated_depsgraph_get().scene_eval
    assert options_of(evaluated).resolution == (32, 20), "renders have an evaluated scene"
    start(cameras)
    assert FakeLive.made[-1].calls[0][1]["samples"] == 16


def test_a_renamed_camera_is_found_and_a_deleted_one_is_named(cameras):
    bpy.ops.relume.add_cameras()
    bpy.data.objects["Close"].name = "Closer"
    assert shot_list.problems(cameras) == {} and shot_list.all_shots(cameras)[1].camera == "Closer"
    bpy.data.objects.remove(bpy.data.objects["Top"])
    assert "'Top' is not in the scene" in shot_list.problems(cameras)["Top"]
    again = bpy.data.objects.new("Top", bpy.data.cameras.new("Top"))
    cameras.collection.objects.link(again)
    assert shot_list.problems(cameras) == {}, "one of the same name is taken"
    cameras.collection.objects.unlink(again)
    again.use_fake_user = True
    assert shot_list.problems(cameras).keys() == {"Top"}, "in the file, but not in the scene"


def test_names_with_dots_and_slashes_have_folders_of_their_own(cameras):
    camera = cameras.camera
    keys = [shot_list.add(cameras, name, camera).key for name in ("a/b", "a_b", "a.b", "../up")]
    assert keys == ["a_b", "a_b_2", "a.b", "up"]
    folders = [found.folder for found in shot_list.all_shots(cameras)]
    assert len(set(folders)) == 4 and len({folder.parent for folder in folders}) == 1
    entries(cameras)[0].name = "renamed"
    assert shot_list.all_shots(cameras)[0].folder == folders[0], "a bake is found under the shot's new name"


def test_two_shots_in_one_folder_are_refused(cameras, tmp_path):
    bpy.ops.relume.add_cameras()
    for entry in entries(cameras)[:2]:
        entry.folder = str(tmp_path / "same")
    assert shot_list.problems(cameras).keys() == {"Close"}
    check_start(cameras)
    cameras.relume_shots.active = 1
    with pytest.raises(ProblemError, match="Shot 'Close': shot 'Camera' has the folder"):
        check_start(cameras)


def test_a_full_copy_of_a_scene_has_folders_of_its_own(cameras, tmp_path):
    cameras.relume.folder = str(tmp_path / "bakes")
    bpy.ops.relume.add_cameras()
    bpy.ops.scene.new(type="FULL_COPY")
    copy = bpy.context.scene
    assert names(copy) == names(cameras) and copy != cameras
    folders = [found.folder for scene in (cameras, copy) for found in shot_list.all_shots(scene)]
    assert len(set(folders)) == 6
    assert shot_list.problems(copy) == {}
    entries(cameras)[0].folder = entries(copy)[0].folder = str(tmp_path / "mine")
    assert "scene 'Scene'" in shot_list.problems(copy)["Camera"]


def test_undo_of_adding_a_shot(cameras):
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.relume.add_cameras()
    bpy.ops.ed.undo_push(message="added")
    start(bpy.context.scene)
    assert shot.of(bpy.context.scene).options.shot == "Camera"
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert names(scene) == [] and current_entry(scene) is None
    remember_bake(scene, shot.of(scene).folder, "Camera")
    bpy.ops.ed.redo()
    assert names(bpy.context.scene) == ["Camera", "Close", "Top"]


def test_the_bake_from_before_the_list_belongs_to_the_shot_of_its_camera(cameras, tmp_path):
    cameras.relume.folder = str(tmp_path / "old")
    remember_bake(cameras, put_bake(tmp_path / "old"))
    shot.Shot.open(cameras)
    bpy.ops.relume.add_cameras()
    assert remembered_bake(cameras) == tmp_path / "old"
    assert shot.of(cameras).options.shot == "Camera"
    cameras.relume_shots.active = 1
    assert remembered_bake(cameras) is None


def test_the_bake_of_the_chosen_shot_is_shown(cameras, tmp_path):
    cameras.relume.folder = str(tmp_path / "bakes")
    bpy.ops.relume.add_cameras()
    for name in ("Camera", "Close"):
        put_bake(tmp_path / "bakes" / f"Scene_{name}", name)
    state = cameras.relume_shots
    state.active = 1
    assert shot.of(cameras).folder == tmp_path / "bakes" / "Scene_Close"
    state.active = 0
    assert shot.of(cameras).folder == tmp_path / "bakes" / "Scene_Camera"
    state.active = 2
    assert shot.of(cameras) is None, "it has no bake, and is started here"
    start(cameras)
    working = shot.of(cameras)
    assert working.is_working
    state.active = 0
    assert shot.of(cameras) is working, "a bake under way goes on"


def test_shots_are_moved_and_removed(cameras):
    bpy.ops.relume.add_cameras()
    state = cameras.relume_shots
    state.active = 0
    assert bpy.ops.relume.move_shot(direction="UP") == {"CANCELLED"}
    assert bpy.ops.relume.move_shot(direction="DOWN") == {"FINISHED"}
    assert names(cameras) == ["Close", "Camera", "Top"] and state.active == 1
    bpy.ops.relume.remove_shot()
    assert names(cameras) == ["Close", "Top"] and state.active == 1
    bpy.ops.relume.remove_shot()
    bpy.ops.relume.remove_shot()
    assert names(cameras) == [] and not bpy.ops.relume.remove_shot.poll()


def test_bakes_of_other_files_are_listed_and_never_written(cameras, tmp_path):
    folder = put_bake(tmp_path / "other", "Their Camera")
    assert bpy.ops.relume.add_bake(directory=str(folder)) == {"FINISHED"}
    entry = entries(cameras)[0]
    assert (entry.name, entry.camera_name) == ("other", "Their Camera") and current_entry(cameras) is None
    with pytest.raises(RuntimeError, match="already"):
        bpy.ops.relume.add_bake(directory=str(folder))
    with pytest.raises(RuntimeError, match="no bake"):
        bpy.ops.relume.add_bake(directory=str(tmp_path / "none"))
    with pytest.raises(RuntimeError, match="No shot is switched on"):
        bpy.ops.relume.bake_all()
    bpy.ops.relume.add_cameras()
    _, found = shot_list.write_file(cameras)
    assert found == ["other"]


def test_the_panel_says_what_is_wrong_with_the_chosen_shot(cameras, monkeypatch):
    words = []
    monkeypatch.setattr(panel, "message", lambda _layout, text, *_icon: words.append(text))
    drawn = SimpleNamespace(layout=MagicMock())
    panel.RELUME_PT_shots.draw(drawn, bpy.context)
    assert "One shot" in words[-1]
    bpy.ops.relume.add_cameras()
    assert panel._mark(cameras, entries(cameras)[1]) == "BLANK1"
    bpy.data.objects.remove(bpy.data.objects["Close"])
    cameras.relume_shots.active = 1
    panel.RELUME_PT_shots.draw(drawn, bpy.context)
    assert words[-1].startswith("Its camera 'Close' is not in the scene")
    assert panel._mark(cameras, entries(cameras)[1]) == "ERROR"
