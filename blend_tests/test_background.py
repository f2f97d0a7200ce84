"""A bake in another Blender: progress, stopping, going on, and that nothing is left behind."""

import dataclasses
import math
import os
import sys
import time

import bpy
import pytest
import relume

import addon
from addon.core.bake_folder import clear, is_bake, size_of
from addon.core.disk import free_space
from addon.engine.shot import background, shot
from addon.engine.shot.checks import ProblemError, disk_space
from addon.engine.shot.options import options_of, remembered_bake
from addon.engine.workers.process import Worker
from addon.live import handlers
from addon.ui import background as ui
from addon.ui.start import start
from helpers import add_light, add_material, add_quad, ended, exported


@pytest.fixture
def room(scene, tmp_path):
    """A lit plane with the add-on enabled; small."""
    addon.register()
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=4.0, material=material)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5, use_soft_falloff=False)
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.relume.quality, scene.relume.samples = "CUSTOM", 16
    scene.relume.folder = str(tmp_path / "bake")
    scene.view_settings.view_transform = "Standard"
    yield scene
    addon.unregister()
    shot.close_all()


@pytest.fixture
def no_training(monkeypatch):
    """Tracing only."""
    train_for(0.0, monkeypatch)


def train_for(seconds, monkeypatch):
    """Sets how long the preferences have it train."""
    plain = background.options_of
    monkeypatch.setattr(
        background, "options_of", lambda scene: dataclasses.replace(plain(scene), train_seconds=seconds)
    )


def test_a_bake_is_made_beside_and_opened(room, tmp_path, no_training):
    temporary = os.listdir(bpy.app.tempdir)
    assert bpy.ops.relume.background_start() == {"FINISHED"}
    job = background.of(room)
    with pytest.raises(RuntimeError, match="being baked in the background"):
        bpy.ops.relume.background_start()
    bpy.data.objects["Key"].location.x = 1.0  # The artist goes on working.
    ended(job)
    assert job.error == "" and job.done
    assert relume.info(tmp_path / "bake")["manifest"]["passes"]
    assert os.listdir(bpy.app.tempdir) == temporary
    found = shot.of(room)
    assert found.folder == tmp_path / "bake" and found.camera == "Camera"
    assert found.changes.sentences == [] and not found.warnings


def test_a_proxy_is_trained_for_each_type_of_light(room, tmp_path, monkeypatch):
    train_for(1.0, monkeypatch)
    stages = set()
    job = background.start(room)
    deadline = time.monotonic() + 120
    while job.is_running and time.monotonic() < deadline:
        job.poll()
        stages.add(job.stage["stage"])
        time.sleep(0.01)
    assert job.done, job.error
    assert (tmp_path / "bake" / "proxy_sphere.safetensors").exists()
    assert {"trace", "train"} <= stages


def test_another_blender_leaves_the_processor_to_the_artists(tmp_path):
    tell = "import json, os; print(json.dumps({'event': 'told', 'niceness': os.nice(0)}))"
    worker = Worker([sys.executable, "-c", tell], tmp_path)
    deadline = time.monotonic() + 60
    while not worker.ended and time.monotonic() < deadline:
        time.sleep(0.02)
    assert worker.events() == [{"event": "told", "niceness": min(os.nice(0) + 10, 19)}]


@pytest.mark.parametrize(
    "stop", [lambda job: job.cancel(), lambda _job: bpy.ops.relume.background_cancel(number=0)], ids=["api", "operator"]
)
def test_a_stopped_bake_goes_on(room, tmp_path, no_training, stop):
    room.relume.samples = 4096
    job = background.start(room)
    deadline = time.monotonic() + 60
    while not list((tmp_path / "bake").glob("tile_*")) and time.monotonic() < deadline:
        job.poll()
        time.sleep(0.01)
    assert bpy.ops.relume.background_cancel(number=1) == {"CANCELLED"} and job.is_running
    stop(job)
    ended(job)
    if not job.done:  # Unless it was quicker than the signal.
        assert "again" in job.error
        before = {path: path.stat().st_mtime_ns for path in (tmp_path / "bake").glob("tile_*")}
        assert ended(background.start(room)).done
        assert all(path.stat().st_mtime_ns == time_ns for path, time_ns in before.items())
    info = relume.info(tmp_path / "bake")
    assert info["shards"][0] == info["shards"][1]


def test_another_scene_in_the_folder_is_replaced_and_foreign_files_stay(room, tmp_path, no_training):
    assert ended(background.start(room)).done
    (tmp_path / "bake" / "notes.txt").write_text("mine")
    first = relume.info(tmp_path / "bake")["manifest"]["scene_hash"]
    room.camera.location.x += 1.0
    shot.close_all()
    job = ended(background.start(room))
    assert job.done, job.error
    assert relume.info(tmp_path / "bake")["manifest"]["scene_hash"] != first
    assert (tmp_path / "bake" / "notes.txt").read_text() == "mine"
    clear(tmp_path / "bake")
    assert [path.name for path in (tmp_path / "bake").iterdir()] == ["notes.txt"]


def test_it_survives_another_file_and_ends_with_the_add_on(room, tmp_path):
    room.relume.samples = 60000
    temporary = set(os.listdir(bpy.app.tempdir))
    job = background.start(room)
    bpy.ops.wm.read_homefile(use_empty=True)
    assert ui.tick() and background.all_jobs() == [job]
    process = job._worker._process
    assert process.poll() is None
    addon.unregister()
    try:
        assert process.poll() is not None and background.all_jobs() == []
        assert set(os.listdir(bpy.app.tempdir)) <= temporary
    finally:
        addon.register()


def test_two_scenes_do_not_share_a_folder(room, no_training):
    assert ended(ui.start(room)).done
    other = room.copy()
    with pytest.raises(ProblemError, match="Another scene"):
        ui.start(other)
    shot.of(room).close()
    bpy.context.window.scene = other
    ui.start(room)
    with pytest.raises(ProblemError, match="background"):
        ui.start(other)


def test_the_scene_of_the_panel_is_baked(room, tmp_path, no_training):
    other = bpy.data.scenes.new("Other")
    for obj in room.objects:
        other.collection.objects.link(obj)
    other.camera, other.relume.folder = room.camera, str(tmp_path / "other")
    other.relume.quality, other.relume.samples = "CUSTOM", 4
    other.render.resolution_x, other.render.resolution_y = 16, 8
    assert ended(ui.start(other)).error == ""
    assert size_of(tmp_path / "other") == (16, 8)


def test_no_bake_goes_beside_a_file_that_is_not_saved(room, monkeypatch, tmp_path):
    room.relume.folder = "//bake"
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RuntimeError, match="not saved"):
        bpy.ops.relume.background_start()
    with pytest.raises(ValueError, match="not saved"):
        options_of(room)
    assert disk_space(room, free_space) == (
        "The bake folder is beside a file that is not saved; save it, or choose another folder",
        False,
    )
    assert not (tmp_path / "bake").exists()


def test_only_a_bake_that_is_there_is_remembered(room, tmp_path, no_training):
    job = ui.start(room)
    assert remembered_bake(room) is None
    assert ended(job).done and remembered_bake(room) == tmp_path / "bake"


TRAINED = [
    ("POINT", {}, "facing-disk"),
    ("POINT", {"use_soft_falloff": False}, "sphere"),
    ("SPOT", {}, "spot"),
    ("SPOT", {"use_soft_falloff": False}, "sphere-spot"),
    ("SPOT", {"scale": (1.0, 2.0, 1.0)}, None),
    ("SPOT", {"spot_size": math.radians(6.0)}, "spot"),
    ("SPOT", {"spot_size": math.radians(5.0)}, None),
    ("SPOT", {"spot_size": math.radians(5.0), "use_soft_falloff": False}, None),
    ("AREA", {}, "quad"),
    ("AREA", {"shape": "DISK"}, "ellipse"),
    ("AREA", {"spread": 1.0}, None),
    ("SUN", {}, None),
]
"""Types of light with settings, and the proxy that is trained for them."""


def test_proxies_are_trained_for_the_types_of_light_that_have_one(room):
    for kind, settings, _ in TRAINED:
        lamp = add_light(room, kind, **{name: value for name, value in settings.items() if name != "scale"})
        lamp.scale = settings.get("scale", (1.0, 1.0, 1.0))
    bpy.data.objects.remove(bpy.data.objects["Key"])
    lights = sorted(exported(room)["lights"], key=lambda light: light["name"])
    assert [relume.Light(light).kind for light in lights] == [kind for *_, kind in TRAINED]


def test_a_file_that_was_closed_meanwhile_shows_its_bake(room, tmp_path, no_training):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    job = ui.start(room)
    bpy.ops.wm.read_homefile(use_empty=True)
    assert ended(job).done
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    handlers.open_bakes()
    assert shot.of(bpy.context.scene).folder == tmp_path / "bake"


def test_what_fails_on_the_way_is_said_in_a_line(room, no_training, monkeypatch):
    def fail(*_arguments):
        raise OSError(28, "No space left on device")

    job = ui.start(room)
    monkeypatch.setattr(job, "_kinds", fail)
    assert "No space left" in ended(job).error
    temporary = os.listdir(bpy.app.tempdir)
    monkeypatch.setattr(background, "Worker", fail)
    with pytest.raises(RuntimeError, match="No space left") as told:
        bpy.ops.relume.background_start()
    assert "Traceback" not in str(told.value) and os.listdir(bpy.app.tempdir) == temporary


def test_what_goes_wrong_is_said(room, tmp_path, no_training):
    (tmp_path / "file").write_text("not a folder")
    room.relume.folder = str(tmp_path / "file" / "bake")
    job = ended(background.start(room))
    assert not job.done and "file" in job.error
    room.camera = None
    with pytest.raises(RuntimeError, match="camera"):
        bpy.ops.relume.background_start()
    assert not is_bake(tmp_path / "bake")


def test_a_finished_bake_leaves_a_live_one_alone(room, tmp_path, no_training):
    job = background.start(room)
    room.relume.folder = str(tmp_path / "other")
    room.relume.samples = 60000
    live = start(room)
    ended(job)
    assert job.done and job.error == "" and shot.of(room) is live and live.is_working
    assert remembered_bake(room) == tmp_path / "other"


def test_a_finished_bake_that_cannot_be_opened_is_said(room, no_training, monkeypatch):
    job = background.start(room)

    def fail(_scene):
        raise RuntimeError("damaged")

    monkeypatch.setattr(ui, "open_bake", fail)
    assert "damaged" in ended(job).error
