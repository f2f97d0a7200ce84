"""A tiny shot with the real native module: from Start to pictures, while the artist does what artists do."""

import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.commands import run
from addon.engine.shot import options, record, shot
from addon.engine.shot.options import remembered_bake
from addon.export.stop import ExportCancelled
from addon.live import handlers
from addon.live.scheduler import scheduler
from addon.ui.start import start
from helpers import SECONDS, add_light, settled, until, update


def test_start_shows_the_light_and_follows_it(studio):
    start(studio)
    found = until(studio, settled, "the first pictures")
    assert found.frame.image.shape == (24, 32, 4)
    before = found.frame.image[..., :3].mean()
    assert before > 0.0
    bpy.data.lights["Key"].energy *= 2.0
    bpy.context.view_layer.update()
    found = until(studio, settled, "a picture of the brighter light")
    assert found.frame.image[..., :3].mean() == pytest.approx(2.0 * before, rel=1e-3)
    bpy.data.objects["Key"].location.x = -1.5
    bpy.context.view_layer.update()
    image = until(studio, settled, "a picture of the moved light").frame.image
    assert image[:, :16, :3].mean() > 1.5 * image[:, 16:, :3].mean()
    bpy.data.objects["Key"].hide_render = True
    bpy.context.view_layer.update()
    assert until(studio, settled, "darkness").frame.image[..., :3].max() == pytest.approx(0.0, abs=1e-6)
    add_light(studio, "AREA", name="Rim")
    bpy.context.view_layer.update()
    assert until(studio, settled, "the new light").frame.image[..., :3].mean() > 0.0


def test_reopened_file_shows_the_same_picture(studio, tmp_path):
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    until(studio, lambda found: settled(found) and found.is_recorded, "the bake")
    image = shot.of(studio).frame.image
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    assert shot.all_open() == []
    shot.Shot.open(scene)
    scheduler.read_lights(scene)
    found = until(scene, settled, "the bake to open")
    assert np.abs(found.frame.image - image).max() < 1e-4
    assert record.read(tmp_path / "bake").camera == "Camera"
    assert found.changes.sentences == []


@pytest.mark.parametrize("renamed", ["saved", "not saved", "elsewhere"])
def test_a_camera_with_another_name_is_found_again(studio, tmp_path, renamed):
    """Its bake knows the new name, unless the camera was renamed while the bake was not open: that is said."""
    path, camera = tmp_path / "shot.blend", studio.camera
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    until(studio, lambda found: settled(found) and found.is_recorded, "the bake")
    bpy.ops.wm.save_mainfile()
    if renamed == "elsewhere":
        shot.close_all()
    camera.name = "Hero"
    update()
    if renamed != "elsewhere":
        found = until(studio, lambda found: found.is_recorded and not found.changes.is_pending, "the new name")
        assert found.camera == "Hero" and found.changes.sentences == []
        assert record.read(tmp_path / "bake").camera == "Hero"
    if renamed != "not saved":
        bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    handlers.open_bakes()
    found = until(scene, lambda found: settled(found) and not found.changes.is_pending, "the bake to open")
    assert found.recognises(scene.camera) == (renamed != "elsewhere")
    assert ("Camera 'Camera' of this bake is not in the scene" in " ".join(found.notes)) == (renamed == "elsewhere")
    assert bool(found.changes.sentences) == (renamed == "elsewhere")


def test_disabled_opened_and_undone_while_baking(studio, tmp_path):
    studio.relume.samples = 4096
    start(studio)
    until(studio, lambda found: found.frame is not None, "the first picture")
    bpy.ops.ed.undo_push(message="one")
    bpy.data.objects["Key"].location.x = 1.0
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.ed.undo()
    scheduler.tick()
    began = time.monotonic()
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.preferences.addon_disable(module="addon")
    bpy.ops.preferences.addon_enable(module="addon")
    assert time.monotonic() - began < SECONDS / 6
    assert shot.all_open() == []


def test_cancelled_bake_keeps_its_samples_and_goes_on(studio):
    studio.relume.samples = 2048
    start(studio)
    found = until(studio, lambda found: found.status["samples"] > 0, "samples")
    found.cancel()
    until(studio, lambda found: found.status["state"] == "cancelled", "the end")
    kept = found.status["samples"]
    assert 0 < kept < 2048
    bpy.ops.relume.start()
    assert until(studio, lambda found: found.status["samples"] > kept, "more samples")


def test_moved_bake_is_missed_by_name_and_found_again(studio, tmp_path):
    path = tmp_path / "here" / "shot.blend"
    path.parent.mkdir()
    studio.relume.folder = ""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    baked = shot.of(studio).folder
    assert baked == path.parent / "relume" / "shot_Scene_Camera"
    until(studio, lambda found: settled(found) and found.is_recorded, "the bake")
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.read_homefile(use_empty=True)
    # The whole folder is moved, as one does with a project.
    path.parent.rename(tmp_path / "there")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "there" / "shot.blend"))
    scene = bpy.context.scene
    assert bpy.ops.relume.show_bake() == {"FINISHED"}
    until(scene, settled, "the moved bake")
    shot.close_all()
    # The bake alone is moved.
    elsewhere = tmp_path / "archive"
    shot_folder = tmp_path / "there" / "relume" / "shot_Scene_Camera"
    shot_folder.rename(elsewhere)
    with pytest.raises(RuntimeError, match="no bake in .*shot_Scene_Camera"):
        bpy.ops.relume.show_bake()
    with pytest.raises(RuntimeError, match="no bake of Relume"):
        bpy.ops.relume.find_bake(directory=str(tmp_path))
    assert bpy.ops.relume.find_bake(directory=str(elsewhere)) == {"FINISHED"}
    until(scene, settled, "the found bake")
    assert remembered_bake(scene) == elsewhere


def test_file_saved_elsewhere_still_finds_its_bake(studio, tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    studio.relume.folder = ""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "one" / "shot.blend"))
    start(studio)
    until(studio, settled, "the bake")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "two" / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "two" / "shot.blend"))
    assert remembered_bake(bpy.context.scene) == tmp_path / "one" / "relume" / "shot_Scene_Camera"


def test_two_scenes_have_shots_of_their_own(studio, tmp_path):
    start(studio)
    bpy.ops.scene.new(type="FULL_COPY")
    second = bpy.context.scene
    assert shot.of(second) is None
    with pytest.raises(RuntimeError, match="Another scene"):
        bpy.ops.relume.start()
    second.relume.folder = str(tmp_path / "second")
    start(second)
    until(studio, settled, "the first scene")
    until(second, settled, "the second scene")
    assert shot.of(studio).folder != shot.of(second).folder
    bpy.data.scenes.remove(second)
    scheduler.tick()
    assert [found.scene_uid for found in shot.all_open()] == [studio.session_uid]


def test_unsaved_file_bakes_into_the_cache_folder(studio, tmp_path):
    studio.relume.folder = ""
    options.preferences().cache_folder = str(tmp_path / "cache")
    start(studio)
    folder = shot.of(studio).folder
    assert folder.parent == tmp_path / "cache" and folder.name.startswith("unsaved_Scene_Camera_")
    until(studio, settled, "the bake")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "late.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "late.blend"))
    assert remembered_bake(bpy.context.scene) == folder


def test_bake_of_the_command_line_is_known_in_the_window(studio, tmp_path):
    assert run(["bake", "--out", str(tmp_path / "bake"), "--samples", "4", "--resolution", "16x12", "--quiet"]) == 0
    assert bpy.ops.relume.show_bake() == {"FINISHED"}
    found = until(studio, lambda found: settled(found) and not found.changes.is_pending, "the bake")
    assert found.frame.image.shape == (12, 16, 4)
    assert found.changes.sentences == ["The picture has 32 x 24 pixels now; the bake has 16 x 12"]
    assert not any("says nothing" in note for note in found.notes)


def test_undo_save_pause_and_disable_while_training(studio, tmp_path):
    options.preferences().train_seconds = 600.0
    start(studio)
    until(studio, lambda found: found.status["state"] == "training", "training")
    bpy.ops.ed.undo_push(message="one")
    bpy.data.objects["Key"].location.x = 1.0
    bpy.ops.ed.undo_push(message="two")
    bpy.ops.ed.undo()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    scene = bpy.context.scene
    assert bpy.ops.relume.pause() == {"FINISHED"}
    found = until(
        scene, lambda found: found.status["paused"] and found.changes.sentences == [] and found.frame, "a pause"
    )
    bpy.data.lights["Key"].energy *= 2.0
    serial = found.frame.serial
    bpy.context.view_layer.update()
    until(scene, lambda found: found.frame.serial > serial, "a picture while paused")
    began = time.monotonic()
    bpy.ops.preferences.addon_disable(module="addon")
    assert time.monotonic() - began < SECONDS / 6
    bpy.ops.preferences.addon_enable(module="addon")
    options.preferences().train_seconds = 0.0
    assert bpy.ops.relume.show_bake() == {"FINISHED"}
    until(scene, settled, "the bake after disabling")


def test_undo_while_training_puts_the_light_back_and_the_training_goes_on(studio):
    options.preferences().train_seconds = 3.0
    start(studio)
    found = until(studio, lambda found: found.status["state"] == "training" and found.frame is not None, "training")
    bpy.ops.ed.undo_push(message="one")
    bpy.data.objects["Key"].location.x = -1.5
    update()
    bpy.ops.ed.undo_push(message="two")
    until(studio, lambda found: found.present_frame is not None, "the picture of the moved light")
    left, right = np.split(found.frame.image[..., :3], 2, axis=1)
    assert left.mean() > 1.5 * right.mean()
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert bpy.data.objects["Key"].location.x == 0.0
    assert shot.of(scene) is found and found.status["state"] == "training"
    until(scene, lambda found: found.status["state"] == "ready" and settled(found), "the proxy")
    left, right = np.split(found.frame.image[..., :3], 2, axis=1)
    assert left.mean() == pytest.approx(right.mean(), rel=0.1)
    assert found.status["proxies"] and not found.status["is_incomplete"] and found.changes.sentences == []


def test_every_type_of_light_is_gathered_before_it_is_learned(studio):
    for kind in ("SUN", "SPOT"):
        add_light(studio, kind, name=kind.title())
    bpy.context.view_layer.update()
    start(studio)
    found = until(studio, settled, "all lights")
    assert set(found.status["shown"]["makers"]) == {"Key", "Sun", "Spot"}
    assert "proxy" not in found.status["shown"]["makers"].values()


def test_rebake_that_is_cancelled_while_reading_keeps_the_bake(studio, tmp_path, monkeypatch):
    start(studio)
    until(studio, lambda found: settled(found) and found.is_recorded, "the bake")

    def cancelled(_scene, _options, done):
        done(None, ExportCancelled("cancelled"))

    with monkeypatch.context() as patched:
        patched.setattr("addon.engine.shot.shot.load_scene_async", cancelled)
        assert bpy.ops.relume.start() == {"FINISHED"}
    found = shot.of(studio)
    assert found.status["state"] == "cancelled" and not found.is_busy
    assert record.read(tmp_path / "bake") is not None
    assert until(studio, settled, "the bake from before").changes.sentences == []


def test_a_file_that_cannot_be_opened_leaves_the_bakes(studio, tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr(handlers, "preferences", lambda: opened.append(bpy.context.scene))
    (tmp_path / "broken.blend").write_text("no file of Blender")
    with pytest.raises(RuntimeError):
        bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "broken.blend"))
    assert opened == [studio]


def test_what_goes_wrong_while_reading_is_one_line(studio, monkeypatch):
    def broken(_scene, _options, done):
        done(None, RuntimeError("object 'Sofa' is broken"))

    monkeypatch.setattr("addon.engine.shot.shot.load_scene_async", broken)
    with pytest.raises(RuntimeError, match="object 'Sofa' is broken"):
        bpy.ops.relume.start()
    assert shot.of(studio) is None and remembered_bake(studio) is None


def test_a_shot_is_not_baked_twice_at_once(studio, monkeypatch):
    job = SimpleNamespace(is_running=True, folder=options.bake_folder(studio))
    monkeypatch.setattr("addon.engine.shot.background._jobs", [job])
    with pytest.raises(RuntimeError, match="baked in the background"):
        bpy.ops.relume.start()
    job.is_running = False
    assert bpy.ops.relume.start() == {"FINISHED"}
    monkeypatch.undo()
