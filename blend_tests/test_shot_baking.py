"""Several shots of a list are baked: on the command line, in the background, and put on a contact sheet."""

import json
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest
import relume

from addon.commands import run
from addon.core.bake_folder import is_bake, size_of
from addon.engine.shot import background, shot, shot_list
from addon.engine.shot.options import remembered_bake
from addon.export.current_shot import entries
from addon.ui import background as ui
from addon.ui.shots import sheet
from helpers import SECONDS

REPOSITORY = Path(__file__).resolve().parents[1]


@pytest.fixture
def shots(studio):
    """Three cameras at two frames, as shots of few samples; a lamp that moves."""
    for name, x in (("Left", -1.0), ("Right", 1.0)):
        camera = bpy.data.objects.new(name, bpy.data.cameras.new(name))
        camera.location = (x, 0.0, 5.0)
        studio.collection.objects.link(camera)
    lamp = bpy.data.objects["Key"]
    lamp.keyframe_insert("location", frame=1)
    lamp.location.x = 1.0
    lamp.keyframe_insert("location", frame=10)
    studio.frame_set(1)
    studio.relume.samples = 4
    bpy.ops.relume.add_cameras()
    last = entries(studio)[2]
    last.use_frame, last.frame = True, 10
    yield studio
    sheet.close_all()
    background.close_all()
    shot.close_all()


def paths(folder):
    """The paths of a bake, and its lights, as bytes."""
    files = [*folder.glob("tile_*"), folder / "lights.json"]
    return {file.name: file.read_bytes() for file in sorted(files)}


def end(scene):
    """Polls until all bakes have ended, as the window's timer does."""
    deadline = time.monotonic() + SECONDS
    while ui.tick() and time.monotonic() < deadline:
        time.sleep(0.02)
    batch = background.batch_of(scene)
    assert not batch.is_running
    return batch


@pytest.mark.oldest_and_newest
def test_shots_of_the_list_have_the_bytes_of_single_bakes(shots, tmp_path, capsys):
    camera, frame = shots.camera, shots.frame_current
    assert run(["bake", "--shots", "all", "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["baked"] == ["Camera", "Left", "Right"] and last["failed"] == {}
    assert (shots.camera, shots.frame_current) == (camera, frame), "the scene is as it was"
    for found in shot_list.all_shots(shots):
        alone = tmp_path / f"alone_{found.name}"
        options = ["--camera", found.camera, "--samples", "4"]
        options += ["--frame", str(found.frame)] if found.frame is not None else []
        assert run(["bake", "--out", str(alone), "--quiet", *options]) == 0
        assert paths(found.folder) == paths(alone) and len(paths(alone)) > 1, found.name
    listed = json.loads(Path(last["shots"]).read_text())["shots"]
    assert [(entry["name"], entry["bake"], entry["frame"]) for entry in listed] == [
        ("Camera", "Scene_Camera", None),
        ("Left", "Scene_Left", None),
        ("Right", "Scene_Right", 10),
    ]
    lights = {name: (tmp_path / "bake" / f"Scene_{name}" / "lights.json").read_text() for name in ("Left", "Right")}
    assert lights["Left"] != lights["Right"], "each frame has its lights"


def test_one_that_fails_keeps_no_other_from_being_baked(shots, tmp_path, capsys):
    bpy.data.objects.remove(bpy.data.objects["Left"])
    assert run(["bake", "--shots", "all", "--out", str(tmp_path / "out"), "--samples", "1"]) == 1
    said = capsys.readouterr()
    assert "shot 'Left': its camera 'Left' is not in the scene" in said.err and "2 of 3" in said.out
    assert is_bake(tmp_path / "out" / "Camera") and is_bake(tmp_path / "out" / "Right")
    listed = json.loads((tmp_path / "out" / "shots.json").read_text())["shots"]
    assert [entry["name"] for entry in listed] == ["Camera", "Right"]


def test_shots_are_named_and_say_themselves_what_they_show(shots, tmp_path, capsys):
    entry = entries(shots)[1]
    shots.view_layers.new("Hero")
    entry.use_size, entry.width, entry.height, entry.layer = True, 20, 10, "Hero"
    assert run(["bake", "--shots", "Left", "--samples", "1", "--quiet"]) == 0
    folder = tmp_path / "bake" / "Scene_Left"
    assert size_of(folder) == (20, 10) and not is_bake(tmp_path / "bake" / "Scene_Camera")
    assert run(["bake", "--shots", "Left,Lost"]) == 1
    assert "there is no shot 'Lost'; there are 'Camera', 'Left', 'Right'" in capsys.readouterr().err
    assert run(["bake", "--shots", "all", "--camera", "Left"]) == 2
    assert "--camera" in capsys.readouterr().err
    assert run(["bake", "--samples", "1"]) == 2
    assert "--out" in capsys.readouterr().err
    assert run(["bake", "--out", str(tmp_path / "x"), "--layer", "Lost"]) == 1
    assert "no view layer 'Lost'" in capsys.readouterr().err


def test_a_view_layer_is_baked_by_its_name(shots, tmp_path):
    hidden = bpy.data.collections.new("Hidden")
    shots.collection.children.link(hidden)
    shots.collection.objects.unlink(bpy.data.objects["Key"])
    hidden.objects.link(bpy.data.objects["Key"])
    layer = shots.view_layers.new("Dark")
    layer.layer_collection.children["Hidden"].exclude = True
    for name in ("", "Dark"):
        options = ["--layer", name] if name else []
        assert run(["bake", "--out", str(tmp_path / f"out{name}"), "--samples", "1", "--quiet", *options]) == 0
    lights = [json.loads((tmp_path / folder / "lights.json").read_text())["lights"] for folder in ("out", "outDark")]
    assert [len(found) for found in lights] == [1, 0]


def test_the_script_knows_the_list_without_the_add_on(shots, tmp_path):
    file = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(file))
    script = REPOSITORY / "relume_bake.py"
    command = [sys.executable, str(script), str(file), "--", "bake", "--shots", "Left,Right", "--samples", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert is_bake(tmp_path / "bake" / "Scene_Left") and is_bake(tmp_path / "bake" / "Scene_Right")


def test_all_shots_are_baked_in_the_background_and_failures_are_named(shots, tmp_path):
    entries(shots)[0].on = False
    bpy.data.objects.remove(bpy.data.objects["Left"])
    assert bpy.ops.relume.bake_all() == {"FINISHED"}
    assert not bpy.ops.relume.bake_all.poll() and bpy.ops.relume.stop_baking.poll()
    batch = end(shots)
    assert batch.baked == ["Right"] and batch.failures.keys() == {"Left"}
    assert not is_bake(tmp_path / "bake" / "Scene_Camera")
    assert remembered_bake(shots, "Right") == tmp_path / "bake" / "Scene_Right"
    assert shot.of(shots) is None, "it is not the current shot"
    listed = json.loads((tmp_path / "bake" / "Scene_shots.json").read_text())["shots"]
    assert [entry["name"] for entry in listed] == ["Right"]


def test_a_job_that_fails_leaves_the_rest_of_its_batch(shots, tmp_path, monkeypatch):
    plain = background.blender_command

    def broken(blend, arguments):
        return [sys.executable, "-c", "print('Error: no'); exit(1)"] if "Left" in arguments else plain(blend, arguments)

    monkeypatch.setattr(background, "blender_command", broken)
    bpy.ops.relume.bake_all()
    bpy.ops.relume.stop_baking()
    stopped = end(shots)
    assert {"Left", "Right"} <= stopped.failures.keys() and "start it again" in stopped.failures["Right"]
    bpy.ops.relume.bake_all()
    batch = end(shots)
    assert batch.baked == ["Camera", "Right"] and batch.failures == {"Left": "Error: no"}
    assert shot.of(shots).folder == tmp_path / "bake" / "Scene_Camera", "the current shot is shown"


def test_the_contact_sheet_shows_all_shots_under_the_present_lights(shots, tmp_path):
    with pytest.raises(RuntimeError, match="Show the bake"):
        bpy.ops.relume.contact_sheet()
    assert run(["bake", "--shots", "all", "--quiet"]) == 0
    shots.relume_shots.active = 1
    assert shot.of(shots).folder == tmp_path / "bake" / "Scene_Left"
    assert bpy.ops.relume.contact_sheet() == {"FINISHED"}
    deadline = time.monotonic() + SECONDS
    while sheet.tick() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert sheet.failure(shots) == ""
    image = bpy.data.images[sheet.IMAGE]
    assert image.packed_file is not None and image.size[0] > 3 * 32
    out = tmp_path / "sheet.png"
    assert bpy.ops.relume.save_sheet(filepath=str(out)) == {"FINISHED"}
    listed = tmp_path / "bake" / "Scene_shots.json"
    assert run(["relight", f"--shots={listed}", "--out", str(tmp_path / "{shot}.exr"), "--quiet"]) == 0
    assert (tmp_path / "Left.exr").exists() and (tmp_path / "Right.png").exists()
    job = relume.start("relight", shots=listed, sheet=tmp_path / "same.png")
    assert [entry["name"] for entry in job.wait()["shots"]] == ["Camera", "Left", "Right"]
    assert out.read_bytes() != (tmp_path / "same.png").read_bytes(), "the last shot's own lamp is elsewhere"
