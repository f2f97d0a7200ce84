"""Start, status and the controls, with a native module that answers as the test says."""

import errno
import os
import subprocess
import sys

import bpy
import pytest

import addon
from addon.engine.shot import checks, shot
from addon.engine.shot.checks import ProblemError
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive


def test_start_bakes_and_asks_for_the_present_lights(lit):
    found = start(lit)
    (live,) = FakeLive.made
    assert live.calls[0][0] == "bake" and live.calls[0][1]["samples"] == 64
    assert [light["name"] for light in live.requests[-1]["lights"]] == ["Key"]
    assert live.requests[-1]["interactive"] is False
    assert shot.of(lit) is found and found.camera == "Camera"


def test_operator_does_what_the_function_does(lit):
    start(lit)
    assert bpy.ops.relume.start() == {"FINISHED"}
    by_function, by_operator = FakeLive.made
    assert by_function.calls[0] == by_operator.calls[0]
    assert by_function.requests == by_operator.requests
    assert by_function.arguments == by_operator.arguments
    assert by_function.calls[-1] == ("close",)


def test_rebake_asks_for_paths_that_look_for_moved_lights(lit):
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    assert FakeLive.made[-1].calls[0][-1] == "anew"
    assert bpy.ops.relume.start() == {"FINISHED"}
    assert "anew" not in FakeLive.made[-1].calls[0]


def test_pause_and_cancel_reach_the_native_module(lit):
    found = start(lit)
    scheduler.tick()
    assert bpy.ops.relume.pause() == {"FINISHED"}
    scheduler.tick()
    assert found.status.live.paused and bpy.ops.relume.pause() == {"FINISHED"}
    scheduler.tick()
    assert not found.status.live.paused
    assert bpy.ops.relume.cancel() == {"FINISHED"}
    scheduler.tick()
    assert found.status.phase == "cancelled"


def no_camera(scene, _folder, _monkeypatch):
    scene.camera = None
    return "no camera"


def scripted_camera(scene, _folder, _monkeypatch):
    if bpy.app.version < (5, 0, 0):
        pytest.skip("this Blender has no such cameras")
    scene.camera.data.type = "CUSTOM"
    return "'Camera' is custom"


def file_in_the_way(_scene, folder, _monkeypatch):
    folder.write_text("a file")
    return "is a file"


def beside_no_file(scene, _folder, _monkeypatch):
    scene.relume.folder = "//bake"
    return "not saved"


def fails_with(number):
    """A file system that refuses files, by the number of the error."""

    def mistake(_scene, _folder, monkeypatch):
        def refuse(**_options):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr("addon.engine.shot.checks.tempfile.TemporaryFile", refuse)
        return {errno.ENOSPC: "disk is full", errno.EROFS: "read-only", errno.EACCES: "read-only"}[number]

    return mistake


def no_pixels(scene, _folder, _monkeypatch):
    scene.render.resolution_x, scene.render.resolution_percentage = 99, 1
    return "The picture of scene 'Scene' has no pixels; raise the resolution"


def empty_region(scene, _folder, _monkeypatch):
    render = scene.render
    render.use_border, render.border_min_x, render.border_max_x = True, 0.5, 0.501
    return "The render region of scene 'Scene' is empty; draw it anew"


MISTAKES = {
    "no camera": no_camera,
    "scripted camera": scripted_camera,
    "no pixels": no_pixels,
    "empty region": empty_region,
    "file in the way": file_in_the_way,
    "beside no file": beside_no_file,
    "disk full": fails_with(errno.ENOSPC),
    "read-only disk": fails_with(errno.EROFS),
    "read-only folder": fails_with(errno.EACCES),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_what_keeps_a_shot_from_starting_is_one_clear_line(lit, tmp_path, monkeypatch, mistake):
    words = MISTAKES[mistake](lit, tmp_path / "bake", monkeypatch)
    with pytest.raises(ProblemError, match=words) as error:
        start(lit)
    assert "\n" not in str(error.value)
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.relume.start()
    assert shot.of(lit) is None and FakeLive.made == []


def test_the_disk_space_is_estimated_and_missed(lit):
    lit.render.resolution_x, lit.render.resolution_y, lit.render.resolution_percentage = 1920, 1080, 50
    lit.relume.quality = "GOOD"
    assert checks.disk_space(lit, lambda _: int(2e9)) == ("About 1.8 GB on disk", True)
    assert checks.disk_space(lit, lambda _: int(2e8)) == ("About 1.8 GB on disk, but only 200.0 MB free", False)
    assert checks.disk_space(lit, lambda _: None) == ("About 1.8 GB on disk", True)


def test_start_changes_nothing_of_the_scene_but_where_the_bake_is(lit, tmp_path):
    before = {name: getattr(lit.render, name) for name in ("engine", "use_compositing", "filepath")}
    start(lit)
    assert {name: getattr(lit.render, name) for name in before} == before
    assert lit.relume.baked_folder == str(tmp_path / "bake")


def everything_registered():
    """Handlers, classes and properties, which an add-on can leave behind."""
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers) if not name.startswith("_")}
    handler_lists = {name: list(value) for name, value in lists.items() if isinstance(value, list)}
    classes = sorted(name for name in dir(bpy.types) if "relume" in name.lower())
    owners = (bpy.types.Scene, bpy.types.View3DShading)
    properties = sorted(name for owner in owners for name in dir(owner) if "relume" in name)
    return handler_lists, classes, properties, len(addon._registered)


def test_enable_disable_enable_leaves_nothing_behind(scene):
    before = everything_registered()
    for _ in range(2):
        addon.register()
        assert everything_registered() != before
        addon.unregister()
        assert everything_registered() == before


def test_registering_does_not_import_the_native_module():
    code = "import sys, addon; addon.register(); assert 'relume' not in sys.modules; addon.unregister()"
    command = f"import os; {code}; os._exit(0)"
    done = subprocess.run(
        [sys.executable, "-c", command], cwd=os.path.dirname(os.path.dirname(__file__)), capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


def test_disabling_while_baking_closes_everything(lit):
    start(lit)
    addon.unregister()
    assert FakeLive.made[0].calls[-1] == ("close",)
    addon.register()
