"""The Blender in the background that colours the tables of views and writes their files."""

import os
import time

import bpy
import numpy as np
import pytest

from addon.engine.workers import process, view_worker
from addon.engine.workers.view_worker import ViewWorker, file_of, table_of
from addon.export import write_view_table
from addon.export.color_table import color_table
from addon.export.view_file import stamp
from addon.export.view_transform import view_settings
from helpers import update
from views import VIEWS

SECONDS = 120.0


@pytest.fixture
def started(monkeypatch):
    """The other Blenders that were started."""
    workers = []
    monkeypatch.setattr(view_worker, "Worker", lambda *asked: workers.append(process.Worker(*asked)) or workers[-1])
    return workers


@pytest.fixture
def worker():
    worker = ViewWorker()
    yield worker
    worker.drop()


def table(worker, scene):
    """The table of a scene's view."""
    worker.ask(table_of(view_settings(scene)))
    return turns(worker, lambda found: found is not None)


def turns(worker, is_done):
    """Polls a worker until something is done; what its last turn gave."""
    until = time.monotonic() + SECONDS
    while not is_done(found := worker.turn()):
        assert time.monotonic() < until
        time.sleep(0.01)
    return found


def same(found, expected):
    (entries, levels), (wanted, places) = found, expected
    both = levels is not None and places is not None
    return np.array_equal(entries, wanted) and (np.array_equal(levels, places) if both else levels is places)


@pytest.mark.parametrize(
    "name",
    [
        "AgX, exposure and gamma",
        pytest.param("AgX, curves", marks=pytest.mark.slow),
        "AgX, white balance",
        pytest.param("False Color", marks=pytest.mark.slow),
    ],
)
def test_its_tables_and_files_are_those_of_this_blender(scene, worker, tmp_path, name):
    VIEWS[name](scene)
    here, there = tmp_path / "here.png", tmp_path / "there.png"
    assert same(table(worker, scene), color_table(scene))
    worker.ask(file_of(view_settings(scene), there, stamp(scene)))
    turns(worker, lambda _found: there.exists())
    write_view_table(scene, here)
    assert here.read_bytes() == there.read_bytes()


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="files choose their working space from Blender 5.0 on")
def test_its_files_have_the_working_space_of_this_one(scene, worker):
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    scene.view_settings.view_transform = "AgX"
    assert same(table(worker, scene), color_table(scene))


def test_a_newer_view_replaces_the_one_before(scene, worker, started):
    scene.view_settings.view_transform = "AgX"
    worker.ask(table_of(view_settings(scene)))
    turns(worker, lambda _found: started)
    scene.view_settings.gamma = 1.5
    assert same(table(worker, scene), color_table(scene))
    assert started[0].code != 0 and len(started) == 2


def test_while_a_view_is_dragged_no_blender_starts(scene, worker, started, monkeypatch):
    monkeypatch.setattr(view_worker, "SETTLE_SECONDS", 60.0)
    scene.view_settings.view_transform = "AgX"
    for step in range(10):
        scene.view_settings.gamma = 1.0 + 0.1 * step
        worker.ask(table_of(view_settings(scene)))
        worker.turn()
    assert not started
    monkeypatch.setattr(view_worker, "SETTLE_SECONDS", 0.0)
    worker.turn()
    assert len(started) == 1


def test_what_cannot_be_done_is_said_and_may_be_asked_again(scene, worker, tmp_path):
    scene.view_settings.view_transform = "AgX"
    path = tmp_path / "missing" / "view.png"
    job = file_of(view_settings(scene), path, stamp(scene))
    worker.ask(job)
    with pytest.raises(OSError, match="missing"):
        turns(worker, lambda _found: False)
    path.parent.mkdir()
    worker.ask(job)
    turns(worker, lambda _found: path.exists())


def test_one_that_was_killed_is_said(scene, worker, started):
    scene.view_settings.view_transform = "AgX"
    worker.ask(table_of(view_settings(scene)))
    turns(worker, lambda _found: started)
    started[0].kill()
    with pytest.raises(OSError, match="ended from outside"):
        turns(worker, lambda _found: False)


def test_the_open_file_is_left_alone(scene, worker):
    """Blender would ask the artist who presses Ctrl S about an image that nobody has seen, and evaluate all objects
    again whenever one goes."""
    scene.view_settings.view_transform = "AgX"
    scene.render.image_settings.file_format = "OPEN_EXR"
    update()
    seen = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: seen.append(1))
    try:
        table(worker, scene)
        update()
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
    assert not seen and not bpy.data.images and scene.render.image_settings.file_format == "OPEN_EXR"


def test_dropping_leaves_nothing_behind(scene, worker, started):
    before = set(os.listdir(bpy.app.tempdir))
    scene.view_settings.view_transform = "AgX"
    worker.ask(table_of(view_settings(scene)))
    turns(worker, lambda _found: started)
    assert set(os.listdir(bpy.app.tempdir)) > before
    worker.drop()
    until = time.monotonic() + SECONDS
    while started[0].code is None or not set(os.listdir(bpy.app.tempdir)) <= before:
        assert time.monotonic() < until
        time.sleep(0.01)
