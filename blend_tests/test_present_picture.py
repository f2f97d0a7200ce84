"""Verifying and keeping take the picture of the present lights and rows, never an older one nor that of a look."""

import json

import bpy
import numpy as np
import pytest
from solve_steps import begin

from addon.engine.shot import shot
from addon.live import comparison as comparing
from addon.live.scheduler import scheduler
from addon.ui import looks, verify
from addon.ui.start import start
from fake_live import FakeLive
from helpers import row


@pytest.fixture
def verified(monkeypatch):
    """The pictures that were handed to Cycles' Blender, which is not started."""
    found = []
    monkeypatch.setattr(verify.verify, "start", lambda _scene, frame, *_more: found.append(frame))
    return found


def picture_arrives(**how):
    """The newest request is answered."""
    live = FakeLive.made[-1]
    live.show(serial=live.newest.serial + 1, **how)
    scheduler.tick()
    return live.newest


def preview(scene):
    """A solver shows how far it is."""
    solving, job = begin(scene)
    lights = {"format": "relume-lights", "version": 1, "lights": [{"name": "Key"}]}
    job.previews.append({"lights": lights, "world": [0.5, 0.25, 0.125]})
    solving.step()
    return solving


def test_a_picture_of_before_an_edit_is_not_verified(baked, verified):
    row(baked, "Key").exposure = 1.0
    with pytest.raises(RuntimeError, match="on its way"):
        bpy.ops.relume.verify()
    frame = picture_arrives()
    assert bpy.ops.relume.verify() == {"FINISHED"} and verified == [frame]


def test_a_picture_of_a_look_is_not_verified(baked, verified):
    looks.snapshot(baked, "One")
    looks.snapshot(baked, "Two")
    comparison = comparing.start(baked, list(baked.relume_looks.items))
    picture_arrives()
    with pytest.raises(RuntimeError, match="looks are being compared"):
        bpy.ops.relume.verify()
    comparison.step()
    picture_arrives()
    assert not comparison.step()
    frame = picture_arrives()
    assert bpy.ops.relume.verify() == {"FINISHED"} and verified == [frame]


def test_a_picture_of_a_solver_is_not_verified(painted, verified):
    solving = preview(painted)
    picture_arrives()
    with pytest.raises(RuntimeError, match="lights are being solved"):
        bpy.ops.relume.verify()
    solving.cancel()
    frame = picture_arrives()
    assert bpy.ops.relume.verify() == {"FINISHED"} and verified == [frame]


def test_lights_that_have_no_picture_are_not_verified(baked, verified, monkeypatch):
    def refuse(_live, _request):
        raise ValueError("light 'Key' is too small")

    monkeypatch.setattr(FakeLive, "relight", refuse)
    row(baked, "Key").exposure = 1.0
    with pytest.raises(RuntimeError, match="light 'Key' is too small"):
        bpy.ops.relume.verify()
    assert not verified


def test_a_snapshot_while_lights_are_solved_is_of_the_present(painted, capfd):
    solving = preview(painted)
    picture_arrives()
    assert bpy.ops.relume.snapshot() == {"FINISHED"}
    look = looks.active_look(painted)
    request = json.loads(look.request)
    assert [light["name"] for light in request["lights"]] == ["Key", "Fill"]
    assert request["world"] == [0.0] * 3, "the scene has none"
    assert look.thumbnail == "" and "has no thumbnail" in capfd.readouterr().out
    solving.cancel()
    picture_arrives()
    assert looks.snapshot(painted).thumbnail != ""


def test_a_snapshot_after_an_edit_has_no_older_picture(baked):
    assert looks.snapshot(baked).thumbnail != ""
    row(baked, "Key").exposure = 1.0
    assert looks.snapshot(baked).thumbnail == ""


def test_pictures_are_waited_for_after_a_failure(baked):
    found, live = shot.of(baked), FakeLive.made[-1]
    live.tell(state="failed", error="No space left on device (os error 28)")
    scheduler.tick()
    assert not found.is_busy
    row(baked, "Key").exposure = 1.0
    scheduler.request_picture(baked)
    assert scheduler.tick() and found.is_busy
    frame = picture_arrives(value=0.75)
    assert found.frame is frame and np.all(frame.image == 0.75) and not found.is_busy


def test_nothing_is_waited_for_where_a_failure_left_no_paths(lit_by_two):
    start(lit_by_two)
    FakeLive.made[-1].tell(state="failed", error="the folder cannot be written")
    scheduler.tick()
    assert not shot.of(lit_by_two).is_busy


def test_looks_are_compared_after_a_failure(baked):
    looks.snapshot(baked, "One")
    FakeLive.made[-1].tell(state="failed", error="No space left on device (os error 28)")
    scheduler.tick()
    comparison = comparing.start(baked, list(baked.relume_looks.items))
    assert comparison.step(), "its picture is waited for"
    picture_arrives()
    assert not comparison.step() and len(comparison.frames) == 1
