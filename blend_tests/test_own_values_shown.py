"""Values of rows in single shots are seen wherever a shot is: in its picture, beside it, on the sheet and in F12."""

import json
import time

import bpy
import numpy as np
import pytest

from addon.commands import run
from addon.engine.shot import background, open_shots, requests, shot
from addon.engine.shot.shot import Shot
from addon.export.current_shot import entries
from addon.live import rows
from addon.live.scheduler import scheduler
from addon.ui.shots import sheet
from exr import read_exr
from helpers import SECONDS, row, write_multilayer

pytestmark = pytest.mark.oldest_and_newest

SHOTS = ("Camera", "Left", "Right")
GAINS = {"Camera": 1.0, "Left": 0.0, "Right": 4.0}


@pytest.fixture
def shots(studio):
    """Three cameras at one place, each baked as a shot: their pictures differ by rows alone."""
    studio.cycles.use_denoising = False
    for name in SHOTS[1:]:
        camera = studio.camera.copy()
        camera.name = name
        studio.collection.objects.link(camera)
    studio.relume.samples = 4
    bpy.ops.relume.add_cameras()
    assert run(["bake", "--shots", "all", "--quiet"]) == 0
    rows.sync(studio)
    for name, values in (("Left", {"on": False}), ("Right", {"exposure": 2.0})):
        key = row(studio, "Key")
        rows.give_own_values(key, name, key.values())
        for value in values.items():
            setattr(rows.own_values(row(studio, "Key"), name), *value)
    yield studio
    sheet.close_all()
    background.close_all()
    shot.close_all()


def compared(pictures):
    """Checks the brightness of each shot's picture against that of the first."""
    common = pictures["Camera"].mean()
    assert common > 0.0
    for name, gain in GAINS.items():
        assert pictures[name].mean() == pytest.approx(gain * common, rel=1e-3), name


def wait(found):
    """Polls shots until each has its last picture of the present rows."""
    deadline = time.monotonic() + SECONDS
    while any(each.present_frame is None or each.is_busy for each in found):
        assert time.monotonic() < deadline, [each.status for each in found]
        for each in found:
            each.poll()
        time.sleep(0.02)


def test_pictures_beside_each_other_have_the_values_of_their_shots(shots):
    shots.relume_shots.active = 0
    for entry in entries(shots)[1:]:
        Shot.open(shots, beside=entry)
    scheduler.read_lights(shots)
    found = open_shots.all_of(shots)
    assert [each.key for each in found] == list(SHOTS)
    wait(found)
    before = {each.key: each.present_frame.image[..., :3].copy() for each in found}
    compared(before)
    requests_before = {each.key: each._request_number for each in found}
    rows.own_values(row(shots, "Key"), "Right").exposure = 1.0
    scheduler.request_picture(shots)
    changed = {each.key for each in found if each._request_number != requests_before[each.key]}
    assert changed == {"Right"}, "an edit of one shot asks for no picture of others"


def test_each_shot_is_rendered_with_its_values(shots, tmp_path):
    pictures = {}
    for number, name in enumerate(SHOTS):
        shots.relume_shots.active = number
        shots.render.engine = "RELUME"
        write_multilayer(shots, tmp_path / f"{name}.exr")
        bpy.ops.render.render(write_still=True)
        found = read_exr(tmp_path / f"{name}.exr")
        pictures[name] = np.stack([found[f"ViewLayer.Combined.{channel}"] for channel in "RGB"])
    compared(pictures)


def test_the_sheet_and_the_program_light_each_shot_by_its_values(shots, tmp_path):
    shots.relume_shots.active = 1
    opened = shot.of(shots)
    wait([opened])
    content = sheet.content_of(shots, opened)
    assert content["gains"] == {"Key": [1.0, 1.0, 1.0]} and content["shots"].keys() == {"Left", "Right"}
    request = tmp_path / "request.json"
    request.write_text(requests.request_text(content))
    listed = tmp_path / "bake" / "Scene_shots.json"
    words = [f"--shots={listed}", f"--request={request}", "--out", str(tmp_path / "{shot}.exr"), "--float"]
    assert run(["relight", *words, "--quiet"]) == 0
    pictures = {}
    for name in SHOTS:
        found = read_exr(tmp_path / f"{name}.exr")
        pictures[name] = np.stack([found[f"ViewLayer.Combined.{channel}"] for channel in "RGB"])
    compared(pictures)
    started = sheet.start(shots)
    asked = json.loads((started.file.parent / "request.json").read_text())
    assert asked["shots"]["Left"]["gains"] == {"Key": [0.0, 0.0, 0.0]}
    deadline = time.monotonic() + SECONDS
    while sheet.tick() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert sheet.failure(shots) == ""
