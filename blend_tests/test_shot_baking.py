"""Several shots of a list are baked: on the command line, in the background, and put on a contact sheet."""

import json
import subprocess
import sys
import time
from pathlib import Path

import bpy
import pytest
import relume

from addon import shot_commands
from addon.commands import run
from addon.core import bake_goal
from addon.core.bake_folder import is_bake, size_of
from addon.engine.reading.scene import load_scene_for
from addon.engine.shot import background, shot, shot_list
from addon.engine.shot.options import preferences, remembered_bake
from addon.export.active_camera import asks_for_camera
from addon.export.current_shot import entries
from addon.ui import background as ui
from addon.ui.shots import sheet
from helpers import SECONDS, add_quad

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


@pytest.fixture
def readings(monkeypatch):
    """Cameras for which a scene is read."""
    found = []

    def load(scene, options):
        found.append(options.camera)
        return load_scene_for(scene, options)

    monkeypatch.setattr(shot_commands, "load_scene_for", load)
    return found


@pytest.mark.oldest_and_newest
def test_shots_of_the_list_have_the_bytes_of_single_bakes(shots, readings, tmp_path, capsys):
    camera, frame = shots.camera, shots.frame_current
    assert run(["bake", "--shots", "all", "--json"]) == 0
    last = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert last["baked"] == ["Camera", "Left", "Right"] and last["failed"] == {}
    assert (shots.camera, shots.frame_current) == (camera, frame), "the scene is as it was"
    assert readings == ["Camera", "Right"], "two are of one frame, and the scene is read once for both"
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


def cull(scene):
    """Has a cube be left out for the camera that it is behind."""
    scene.render.use_simplify = scene.cycles.use_camera_cull = True
    cube = add_quad(scene, "Beside", size=0.5)
    cube.location = (3.0, 0.0, 0.0)
    cube.cycles.use_camera_cull = True


def dice(scene):
    """Subdivides the floor adaptively."""
    floor = bpy.data.objects["Plane"]
    floor.modifiers.new("Subdivision", "SUBSURF")
    if bpy.app.version < (5, 0, 0):
        scene.cycles.feature_set, floor.cycles.use_adaptive_subdivision = "EXPERIMENTAL", True
    else:
        floor.modifiers[0].use_adaptive_subdivision = True


def ask_in_material(scene):
    """Has the floor's colour follow its place before the camera."""
    material = bpy.data.materials["White"]
    node = material.node_tree.nodes.new("ShaderNodeVectorTransform")
    node.convert_from, node.convert_to = "WORLD", "CAMERA"
    socket = next(each for each in material.node_tree.nodes if each.type == "BSDF_DIFFUSE").inputs["Color"]
    node.inputs["Vector"].default_value = (0.5, 0.7, 0.9)
    material.node_tree.links.new(node.outputs[0], socket)


def ask_in_nodes(scene):
    """Has the floor follow the scene's camera by geometry nodes."""
    group = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    group.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    group.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "NodeGroupOutput", "GeometryNodeInputActiveCamera", "GeometryNodeObjectInfo")
    start, end, camera, info = map(group.nodes.new, kinds)
    move = group.nodes.new("GeometryNodeSetPosition")
    for source, target in (
        (camera.outputs[0], info.inputs["Object"]),
        (start.outputs[0], move.inputs["Geometry"]),
        (info.outputs["Rotation"], move.inputs["Offset"]),
        (move.outputs[0], end.inputs[0]),
    ):
        group.links.new(source, target)
    bpy.data.objects["Plane"].modifiers.new("Nodes", "NODES").node_group = group


def shrink_the_lamp(scene):
    """Has the lamp be a point, which is as large as cannot be told from the camera."""
    bpy.data.objects["Key"].data.shadow_soft_size = 0.0


def blur(scene):
    """Has the shutter be open for a while."""
    scene.render.use_motion_blur = True


def hide_a_camera(scene):
    """Leaves a camera out of the view layer, which evaluates it only where it is the scene's."""
    bpy.data.objects["Left"].hide_render = True


DEPENDENT = (cull, dice, ask_in_material, ask_in_nodes, shrink_the_lamp, blur, hide_a_camera)


@pytest.mark.oldest_and_newest
@pytest.mark.parametrize("change", DEPENDENT)
def test_a_scene_that_depends_on_the_camera_is_read_for_each(shots, readings, tmp_path, change):
    change(shots)
    bpy.context.view_layer.update()
    assert run(["bake", "--shots", "Camera,Left", "--samples", "1", "--quiet"]) == 0
    assert readings == ["Camera", "Left"]
    for name in ("Camera", "Left"):
        alone = tmp_path / f"alone_{name}"
        assert run(["bake", "--out", str(alone), "--camera", name, "--samples", "1", "--quiet"]) == 0
        assert paths(tmp_path / "bake" / f"Scene_{name}") == paths(alone), name


@pytest.mark.oldest_and_newest
def test_drivers_of_scenes_and_of_python_may_depend_on_the_camera(shots):
    assert not asks_for_camera()
    driver = bpy.data.objects["Plane"].driver_add("location", 2).driver
    driver.expression = "sin(1.0)"
    assert not asks_for_camera()
    driver.expression = "len('Camera')"
    assert asks_for_camera()
    driver.type = "AVERAGE"
    variable = driver.variables.new()
    variable.type = "SINGLE_PROP"
    assert not asks_for_camera()
    variable.targets[0].id_type = "SCENE"
    variable.targets[0].id, variable.targets[0].data_path = shots, "camera.location[0]"
    assert asks_for_camera()


@pytest.mark.oldest_and_newest
def test_a_camera_that_moves_with_others_is_where_it_would_be_alone(shots, readings, tmp_path):
    holder = bpy.data.objects.new("Holder", None)
    shots.collection.objects.link(holder)
    holder.location.y = 0.5
    left = bpy.data.objects["Left"]
    left.parent, left.data.lens, left.data.dof.use_dof = holder, 35.0, True
    left.data.dof.focus_object = bpy.data.objects["Plane"]
    left.keyframe_insert("location", frame=1)
    bpy.data.objects["Camera"].constraints.new("TRACK_TO").target = holder
    shots.relume_shots.items.move(1, 0)
    assert run(["bake", "--shots", "all", "--samples", "1", "--quiet"]) == 0
    assert readings == ["Left", "Right"]
    for name in ("Camera", "Left"):
        alone = tmp_path / f"alone_{name}"
        assert run(["bake", "--out", str(alone), "--camera", name, "--samples", "1", "--quiet"]) == 0
        assert paths(tmp_path / "bake" / f"Scene_{name}") == paths(alone), name


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


@pytest.fixture
def commands(monkeypatch):
    """Commands that other Blenders are started with."""
    found, plain = [], background.blender_command

    def noted(blend, arguments):
        found.append(arguments)
        return plain(blend, arguments)

    monkeypatch.setattr(background, "blender_command", noted)
    return found


@pytest.mark.oldest_and_newest
def test_shots_of_one_scene_are_traced_by_one_blender(shots, commands, tmp_path):
    preferences().train_seconds = 0.5
    bpy.ops.relume.bake_all()
    batch = background.batch_of(shots)
    assert (batch.job.present, batch.job.ahead) == ("Camera", 0)
    assert end(shots).baked == ["Camera", "Left", "Right"] and batch.failures == {}
    assert [command[0] for command in commands] == ["bake", "train", "train", "bake", "train"]
    assert json.loads(commands[0][commands[0].index("--folders") + 1]).keys() == {"Camera", "Left"}
    assert "Right" in commands[3], "another frame is another scene"
    for name in ("Camera", "Left"):
        alone, folder = tmp_path / f"alone_{name}", tmp_path / "bake" / f"Scene_{name}"
        assert run(["bake", "--out", str(alone), "--camera", name, "--samples", "4", "--quiet"]) == 0
        assert paths(folder) == paths(alone) and list(folder.glob("proxy_*")), name
        assert remembered_bake(shots, name) == folder and bake_goal.read(folder) is None, "nothing is left to do"


def test_one_that_fails_beside_others_is_named_and_tried_alone(shots, commands, tmp_path):
    entries(shots)[2].use_frame = False
    blocked = tmp_path / "bake" / "Scene_Left" / "manifest.json"
    blocked.mkdir(parents=True)
    bpy.ops.relume.bake_all()
    batch = end(shots)
    assert batch.baked == ["Camera", "Right"] and batch.failures.keys() == {"Left"}
    assert "manifest.json" in batch.failures["Left"]
    assert [command.count("--folders") for command in commands] == [1, 0]


def test_a_job_that_fails_leaves_the_rest_of_its_batch(shots, tmp_path, monkeypatch):
    plain = background.blender_command

    def broken(blend, arguments):
        fails = "--folders" in arguments or "Left" in arguments
        return [sys.executable, "-c", "print('Error: no'); exit(1)"] if fails else plain(blend, arguments)

    monkeypatch.setattr(background, "blender_command", broken)
    bpy.ops.relume.bake_all()
    bpy.ops.relume.stop_baking()
    stopped = end(shots)
    assert {"Left", "Right"} <= stopped.failures.keys() and "start it again" in stopped.failures["Right"]
    bpy.ops.relume.bake_all()
    batch = end(shots)
    assert batch.baked == ["Right"] and batch.failures == {"Camera": "Error: no", "Left": "Error: no"}


def test_a_shot_that_was_traced_is_kept_where_its_blender_crashes_at_the_next(shots, tmp_path, monkeypatch):
    assert run(["bake", "--shots", "Camera", "--quiet"]) == 0
    plain = background.blender_command
    told = {"event": "progress", "stage": "shots", "done": 1, "total": 2, "message": "Left", "baked": ["Camera"]}
    crash = f"print({json.dumps(json.dumps(told))}, flush=True); import os; os.abort()"

    def broken(blend, arguments):
        return [sys.executable, "-c", crash] if "--folders" in arguments else plain(blend, arguments)

    monkeypatch.setattr(background, "blender_command", broken)
    bpy.ops.relume.bake_all()
    batch = end(shots)
    assert batch.baked == ["Camera", "Left", "Right"] and batch.failures == {}
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
