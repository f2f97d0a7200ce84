"""Verify: a copy of the file, rendered by Cycles in another Blender, against a picture."""

import json
import os
import sys
import time
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest

import addon
from addon.core import metrics
from addon.engine.cycles import verify
from addon.engine.cycles.mix import write_mix
from addon.engine.cycles.reference import JOB
from addon.engine.cycles.verify import ImageFrame, VerifyError
from addon.engine.workers import process
from addon.ui import panel
from addon.ui import verify as ui
from addon.viewport import compare
from helpers import add_light, add_material, add_quad, background, instance_linked_light, render_cycles

pytestmark = pytest.mark.oldest_and_newest

NEUTRAL = {"gains": {}, "world": [1.0, 1.0, 1.0], "static": [1.0, 1.0, 1.0]}


@pytest.fixture
def shot(scene):
    """A plane under two lights of one data-block, a world and an emissive plane; small."""
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=4.0, material=material)
    key = add_light(scene, "POINT", name="Key", location=(-1, 0, 2), shadow_soft_size=0.5)
    fill = bpy.data.objects.new("Fill", key.data)
    fill.location = (1, 0, 2)
    scene.collection.objects.link(fill)
    glow, tree, output = add_material("Glow")
    emission, ramp = tree.nodes.new("ShaderNodeEmission"), tree.nodes.new("ShaderNodeRGB")
    ramp.outputs[0].default_value = (0.2, 0.4, 0.8, 1.0)
    tree.links.new(ramp.outputs[0], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(scene, name="Lamp", size=0.5, material=glow).location.z = 0.5
    scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 2, 0):
        scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value = (0.1, 0.2, 0.3, 1.0)
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    yield scene
    verify.close_all()


def picture(scene, samples=64):
    """Cycles' own, as a frame."""
    pixels = render_cycles(scene, samples=samples)
    return ImageFrame(np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=-1))


def showing(frame):
    """A shot with the picture of its present lights."""
    return SimpleNamespace(frame=frame, present_frame=frame, camera="Camera", refusal="", key="")


def wait(found, seconds=120):
    """Polls until it is over, as the window's timer does."""
    deadline = time.monotonic() + seconds
    while found.is_running and time.monotonic() < deadline:
        found.poll()
        time.sleep(0.02)
    assert not found.is_running
    return found


def end(found):
    """Waits for a result."""
    wait(found)
    assert found.error == ""
    return found


def test_the_render_of_cycles_itself_is_verified(shot):
    before = os.listdir(bpy.app.tempdir)
    found = end(verify.start(shot, picture(shot), "Camera", 64, NEUTRAL))
    assert found.result["error"] < 0.05 and 0.0 < found.result["noise"] < 0.1 and found.result["psnr"] > 30.0
    assert found.reference.image.shape == found.difference.image.shape == (24, 32, 4)
    assert (found.stage["done"], found.stage["total"], found.stage["remaining_s"]) == (8, 8, 0.0)
    assert os.listdir(bpy.app.tempdir) == before or set(os.listdir(bpy.app.tempdir)) - set(before) <= {"cycles.exr"}


def test_clamping_is_left_out_and_what_it_takes_is_said(shot):
    unclamped = picture(shot)
    shot.cycles.sample_clamp_direct = 0.2
    found = end(verify.start(shot, unclamped, "Camera", 64, NEUTRAL))
    assert found.result["error"] < 0.05 and 0.05 < found.result["clamped"] < 0.9
    assert f"takes {100 * found.result['clamped']:.1f} % of this file's light" in ui.words(found)
    assert (found.stage["done"], found.stage["total"]) == (9, 9)


def test_a_wrong_picture_is_noticed(shot):
    wrong = picture(shot)
    wrong.image[:12] *= 1.5
    found = end(verify.start(shot, wrong, "Camera", 32, NEUTRAL))
    assert found.result["error"] > 0.15
    difference = found.difference.image[..., :3].sum(axis=-1)
    assert difference[:12].mean() > 3.0 * difference[12:].mean()


def test_the_mix_is_in_the_copy_only(shot):
    mix = NEUTRAL | {"gains": {"Key": [2.0, 1.0, 0.5], "Fill": [0.0, 0.0, 0.0]}, "static": [3.0, 3.0, 3.0]}
    energies = [light.energy for light in bpy.data.lights]
    found = end(verify.start(shot, picture(shot), "Camera", 64, mix))
    assert [light.energy for light in bpy.data.lights] == energies and not shot.objects["Fill"].hide_render
    write_mix(shot, mix)
    expected = render_cycles(shot, samples=64)
    assert metrics.relative_error(found.reference.image[..., :3], expected) < 0.05


def test_gains_multiply_what_each_source_gives(shot):
    glow = next(n for n in bpy.data.materials["Glow"].node_tree.nodes if n.bl_idname == "ShaderNodeEmission")
    strength, world = glow.inputs["Strength"], shot.world

    def shine(*names):
        for name in ("Key", "Fill"):
            shot.objects[name].hide_render = name not in names
        strength.default_value = float("Lamp" in names)
        shot.world = world if "Sky" in names else None

    def alone(name):
        shine(name)
        return render_cycles(shot, samples=128, max_bounces=2)

    names = ("Key", "Fill", "Lamp", "Sky")
    parts = {name: alone(name) for name in names}
    shine(*names)
    gains = {"Key": [2.0, 1.0, 0.5], "Fill": [0.5, 0.5, 3.0], "Lamp": [1.0, 4.0, 0.0], "Sky": [0.0, 2.0, 5.0]}
    write_mix(shot, {"gains": {n: gains[n] for n in ("Key", "Fill")}, "static": gains["Lamp"], "world": gains["Sky"]})
    mixed = render_cycles(shot, samples=256, max_bounces=2)
    expected = sum(parts[name] * np.array(gains[name], np.float32) for name in parts)
    assert mixed.mean(axis=(0, 1)) == pytest.approx(expected.mean(axis=(0, 1)), rel=0.02)


def test_lights_of_libraries_are_in_the_mix(shot, tmp_path):
    name = instance_linked_light(shot, tmp_path)
    shot.world = None
    whole = render_cycles(shot, samples=64).mean()
    write_mix(shot, {"gains": {"Key": [0.0] * 3, "Fill": [0.0] * 3}, "static": [0.0] * 3, "world": [1.0] * 3})
    alone = render_cycles(shot, samples=64).mean()
    assert 0.0 < alone < 0.9 * whole
    write_mix(shot, NEUTRAL | {"gains": {name: [0.5] * 3}})
    assert render_cycles(shot, samples=64).mean() == pytest.approx(0.5 * alone, rel=0.05)
    write_mix(shot, NEUTRAL | {"gains": {name: [0.0] * 3}})
    assert render_cycles(shot, samples=64).max() == 0.0


def test_cancel_ends_the_process_and_leaves_nothing(shot):
    before = set(os.listdir(bpy.app.tempdir))
    frame = ImageFrame(np.zeros((24, 32, 4), np.float32))
    found = verify.start(shot, frame, "Camera", 100_000, NEUTRAL)
    process = found._worker._process
    assert process.poll() is None and verify.all_running() == [found]
    verify.close_all()
    assert not found.is_running and verify.all_running() == []
    process.wait(60.0)
    until = time.monotonic() + 60.0
    while set(os.listdir(bpy.app.tempdir)) - before and time.monotonic() < until:
        time.sleep(0.01)
    assert set(os.listdir(bpy.app.tempdir)) == before


@pytest.mark.skipif(os.name == "nt", reason="Windows has no signals")
@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("os.kill(os.getpid(), signal.SIGKILL)", "ended from outside (SIGKILL)"),
        ("print('an error of its own'); sys.exit(3)", "an error of its own"),
    ],
)
def test_how_the_other_blender_ended_is_said(shot, monkeypatch, script, words):
    command = [sys.executable, "-c", f"import os, signal, sys; print('Fra:1 Mem:8M', flush=True); {script}"]
    monkeypatch.setattr(verify, "blender_command", lambda *_: command)
    found = wait(verify.start(shot, ImageFrame(np.zeros((24, 32, 4), np.float32)), "Camera", 8, NEUTRAL))
    assert words in found.error and found.result is None


def test_a_disk_that_fills_up_meanwhile_is_said(shot, monkeypatch):
    """Blender says "No such file or directory" there, NumPy counts bytes."""
    told = {"event": "error", "message": "3072 requested and 3040 written"}
    command = [sys.executable, "-c", f"print('{json.dumps(told)}'); raise SystemExit(1)"]
    monkeypatch.setattr(verify, "blender_command", lambda *_: command)
    monkeypatch.setattr(process, "free_space", lambda _: 5_000)
    found = wait(verify.start(shot, ImageFrame(np.zeros((24, 32, 4), np.float32)), "Camera", 8, NEUTRAL))
    assert found.error.startswith("3072 requested and 3040 written; only 5 kB are free on the disk of '")


def test_what_cannot_be_verified_is_said(shot):
    frame = ImageFrame(np.zeros((24, 32, 4), np.float32), scale=2)
    with pytest.raises(VerifyError, match="full size"):
        verify.start(shot, frame, "Camera", 8, NEUTRAL)
    with pytest.raises(VerifyError, match="Nope"):
        verify.start(shot, ImageFrame(frame.image), "Nope", 8, NEUTRAL)
    assert verify.of(shot) is None


def test_it_ends_with_its_scene_and_its_file(shot):
    addon.register()
    try:
        frame = ImageFrame(np.zeros((24, 32, 4), np.float32))
        other = shot.copy()
        found = verify.start(other, frame, "Camera", 100_000, NEUTRAL)
        bpy.data.scenes.remove(other)
        assert not ui.tick() and not found.is_running and not verify._verifications
        found = verify.start(shot, frame, "Camera", 100_000, NEUTRAL)
        bpy.ops.wm.read_homefile(use_empty=True)
        assert not found.is_running and not verify._verifications
    finally:
        addon.unregister()


def test_a_full_disk_is_said_in_a_line(shot, monkeypatch):
    def fail(*_arguments):
        raise OSError(28, "No space left on device")

    addon.register()
    try:
        opened = showing(ImageFrame(np.zeros((24, 32, 4), np.float32)))
        monkeypatch.setattr(ui.shots, "of", lambda scene: opened)
        monkeypatch.setattr(verify, "SavedCopy", fail)
        with pytest.raises(RuntimeError, match="No space left") as told:
            bpy.ops.relume.verify()
        assert "Traceback" not in str(told.value)
    finally:
        addon.unregister()


def test_the_panel_verifies_what_it_shows(shot, tmp_path, monkeypatch):
    linked = instance_linked_light(shot, tmp_path)
    addon.register()
    try:
        shot.relume_verify.samples = 16
        with pytest.raises(RuntimeError, match="no picture yet"):
            bpy.ops.relume.verify()
        opened = showing(picture(shot, samples=16))
        monkeypatch.setattr(ui.shots, "of", lambda scene: opened)
        assert bpy.ops.relume.verify() == {"FINISHED"}
        job = json.loads((verify.of(shot)._copy.folder / JOB).read_text())
        assert set(job["mix"]["gains"]) == {"Key", "Fill", linked}
        found = end(verify.of(shot))
        assert found.result["samples"] == 16 and "Noise of Cycles" in ui.words(found)
        for view, pictures in {
            "WIPE": (found.reference, found.ours),
            "DIFFERENCE": (found.difference, found.difference),
        }.items():
            assert bpy.ops.relume.verify_show(view=view) == {"FINISHED"}
            shown = compare.pair_of(shot)
            assert (shown.a, shown.b) == pictures
        bpy.ops.relume.verify_show(view="LIVE")
        assert compare.pair_of(shot) is None
        bpy.ops.relume.verify()
        running = verify.of(shot)._worker._process
        # The operator cancels as `verify.close` does.
        assert bpy.ops.relume.verify_cancel() == {"FINISHED"}
        assert verify.of(shot) is None
        running.wait(60.0)
        bpy.ops.relume.verify()
        running = verify.of(shot)._worker._process
    finally:
        addon.unregister()
    assert verify.of(shot) is None
    running.wait(60.0)


def drawn(scene):
    """Calls that the panel makes to draw itself."""
    layout = MagicMock()
    ui.RELUME_PT_verify.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene))
    return str(layout.mock_calls)


def test_it_waits_for_the_picture_that_is_on_its_way(shot, monkeypatch):
    monkeypatch.setattr(panel, "characters", lambda *_: 80)
    addon.register()
    try:
        frame = picture(shot, samples=16)
        opened = showing(frame)
        opened.present_frame = None
        monkeypatch.setattr(ui.shots, "of", lambda scene: opened)
        ui.ask(shot)
        assert ui.tick() and ui.is_waiting(shot) and verify.of(shot) is None
        assert ui.WAITS in drawn(shot) and "relume.verify_cancel" in drawn(shot)
        opened.present_frame = ImageFrame(frame.image, scale=2)
        assert ui.tick() and ui.is_waiting(shot) and verify.of(shot) is None
        opened.present_frame = frame
        assert ui.tick() and not ui.is_waiting(shot) and verify.of(shot).is_running
        opened.present_frame = None
        ui.ask(shot)
        assert verify.of(shot) is None, "what ran is ended"
        assert bpy.ops.relume.verify_cancel() == {"FINISHED"}
        assert not ui.tick() and not ui.is_waiting(shot)
        ui.ask(shot)
        opened.refusal = "too many lights"
        assert not ui.tick() and not ui.is_waiting(shot) and "too many lights" in ui._refused[shot.session_uid]
        assert "Not verified" in drawn(shot) and ui.WAITS not in drawn(shot)
        opened.refusal = ""
        ui.ask(shot)
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        assert not ui.tick() and not ui._waiting and not ui._refused
    finally:
        addon.unregister()


def test_metrics_are_those_of_the_native_module():
    ones, twos = np.ones((2, 2, 3), np.float32), np.full((2, 2, 3), 2.0, np.float32)
    assert metrics.relative_error(twos, ones) == 1.0 and metrics.relative_error(ones, ones) == 0.0
    # Exposed to a mean of 0.5: 1 / (1 + 1) - 0.5 / (1 + 0.5) = 1/6.
    assert metrics.psnr_reinhard(twos, ones) == pytest.approx(-20.0 * np.log10(1.0 / 6.0))
    assert metrics.psnr_reinhard(ones, ones) == float("inf")
    assert (metrics.false_color(ones, ones) == 0.0).all()
    black = np.zeros((2, 2, 3), np.float32)
    assert (metrics.false_color(np.full_like(black, np.inf), black) == 1.0).all()
