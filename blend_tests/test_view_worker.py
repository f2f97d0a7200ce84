"""The Blender in the background that colours the tables of views and compiles what draws them."""

import signal
import time
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest

from addon.engine.workers import helper, view_worker
from addon.engine.workers.view_worker import ViewWorker, file_of, programs_of, tables_of
from addon.export import write_view_table
from addon.export.color_table import COARSE, FINE, color_table
from addon.export.view_file import stamp
from addon.export.view_transform import view_settings
from addon.viewport import driver_cache
from helpers import update
from views import VIEWS

SECONDS = 120.0
DRIVER = "vendor_get", "renderer_get", "version_get", "backend_type_get"


@pytest.fixture
def worker():
    yield ViewWorker()
    helper.close()


def turns(worker, job):
    """Has a job done; the tables that come of it, as they come."""
    until = time.monotonic() + SECONDS
    worker.ask(job)
    while not worker.is_finished:
        worker.ask(job)
        found = worker.turn()
        if found is not None:
            table, memory = found
            memory.give_back()
            yield table
        assert time.monotonic() < until
        time.sleep(0.01)


def test_its_tables_and_files_are_those_of_this_blender(scene, worker, tmp_path):
    for name, apply in VIEWS.items():
        try:
            apply(scene)
        except pytest.skip.Exception:
            continue
        here, there = tmp_path / "here.png", tmp_path / "there.png"
        tables = list(turns(worker, tables_of(view_settings(scene))))
        assert [len(table) for table, _ in tables] == [COARSE, FINE], name
        for table, levels in tables:
            entries, places = color_table(scene, len(table))
            assert np.array_equal(table, entries), name
            assert (levels is None) == (places is None) and (levels is None or np.array_equal(levels, places)), name
        assert not list(turns(worker, file_of(view_settings(scene), there, stamp(scene))))
        write_view_table(scene, here)
        assert here.exists() == there.exists() and (not here.exists() or here.read_bytes() == there.read_bytes()), name
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        scene = bpy.context.scene


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="files choose their working space from Blender 5.0 on")
def test_its_files_have_the_working_space_of_this_one(scene, worker):
    for space in ("ACEScg", "Linear Rec.709"):
        bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=False)
        scene.view_settings.view_transform = "AgX"
        coarse, _ = next(turns(worker, tables_of(view_settings(scene))))
        assert np.array_equal(coarse, color_table(scene, COARSE)[0]), space


def test_a_newer_view_replaces_the_one_before(scene, worker):
    scene.view_settings.view_transform = "AgX"
    old = tables_of(view_settings(scene))
    next(turns(worker, old))
    scene.view_settings.gamma = 1.5
    tables = list(turns(worker, tables_of(view_settings(scene))))
    assert [len(table) for table, _ in tables] == [COARSE, FINE]
    assert np.array_equal(tables[0][0], color_table(scene, COARSE)[0])


def test_what_cannot_be_done_is_said_and_may_be_asked_again(scene, worker, tmp_path):
    scene.view_settings.view_transform = "AgX"
    path = tmp_path / "missing" / "view.png"
    for _ in range(2):
        with pytest.raises(OSError, match="missing"):
            list(turns(worker, file_of(view_settings(scene), path, stamp(scene))))
    path.parent.mkdir()
    list(turns(worker, file_of(view_settings(scene), path, stamp(scene))))
    assert path.exists()


def test_one_that_was_killed_is_said_and_started_anew(scene, worker):
    scene.view_settings.view_transform = "AgX"
    job = tables_of(view_settings(scene))
    next(turns(worker, job))
    helper.shared()._worker._signal("SIGKILL")
    with pytest.raises(OSError, match="ended from outside"):
        list(turns(worker, job))
    assert len(list(turns(worker, job))) == 2


def test_one_that_ended_because_nothing_came_is_started_anew(scene, worker, tmp_path, monkeypatch):
    scene.view_settings.view_transform = "AgX"
    list(turns(worker, tables_of(view_settings(scene))))
    other = helper.shared()
    other._place.rename(tmp_path / "away")  # Which ends it in the same way.
    while other.is_running:
        time.sleep(0.01)
    (tmp_path / "away").rename(other._place)
    scene.view_settings.gamma = 1.2
    assert len(list(turns(worker, tables_of(view_settings(scene))))) == 2
    monkeypatch.setattr(helper, "IDLE_SECONDS", 0.0)
    told = []
    helper.serve(other._place, told.append, {})
    assert not told


def test_the_open_file_is_left_alone(scene, worker):
    """Blender would ask the artist who presses Ctrl S about an image that nobody has seen, and evaluate all objects
    again whenever one goes."""
    scene.view_settings.view_transform = "AgX"
    scene.render.image_settings.file_format = "OPEN_EXR"
    update()
    seen = []
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: seen.append(1))
    try:
        for _ in turns(worker, tables_of(view_settings(scene))):
            update()
            assert not bpy.data.images
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
    assert not seen and scene.render.image_settings.file_format == "OPEN_EXR"


def test_it_ends_with_its_owner(scene, worker):
    scene.view_settings.view_transform = "AgX"
    next(turns(worker, tables_of(view_settings(scene))))
    process = helper.shared()._worker._process
    process.stdin.close()
    assert process.wait(SECONDS) != -signal.SIGKILL


def test_closing_leaves_nothing_behind(scene, worker):
    next(turns(worker, tables_of(view_settings(scene))))
    place, process = helper.shared()._place, helper.shared()._worker._process
    helper.close()
    process.wait(SECONDS)
    until = time.monotonic() + SECONDS
    while place.exists() and time.monotonic() < until:
        time.sleep(0.01)
    assert not place.exists()


@pytest.fixture
def kept_by_driver(tmp_path, monkeypatch):
    """Names of what the graphics driver, that of Mesa, keeps on disk, and Blender for it on Vulkan; counted anew by
    each call."""
    if not hasattr(gpu, "init"):
        pytest.skip("Blender draws without a window from 5.2 on")
    folder = tmp_path / "compiled"
    for name in ("MESA_SHADER_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(folder))
    monkeypatch.setenv("LIBGL_ALWAYS_SOFTWARE", "1")
    return lambda: {path.name for path in folder.rglob("*") if path.is_file()}


def test_what_it_compiles_is_compiled_by_no_other_one(scene, kept_by_driver):
    job, kept = programs_of((240, 240)), []
    for _ in range(2):
        assert not list(turns(ViewWorker(), job))
        until_still(kept_by_driver)
        helper.close()
        kept.append(kept_by_driver())
    assert len(kept[0]) > 1 and kept[0] == kept[1]
    list(turns(ViewWorker(), programs_of((256, 256))))
    until_still(kept_by_driver)
    helper.close()
    if any(name.endswith(".spv") for name in kept[1]):
        assert kept[1] == kept_by_driver(), "to Vulkan sizes are all the same"
    else:
        assert kept[1] < kept_by_driver(), "pictures with edges that are powers of two"


def until_still(look, seconds=2.0):
    """Waits until what is seen has not changed for a while."""
    before, since = look(), time.monotonic()
    while time.monotonic() - since < seconds:
        time.sleep(0.05)
        if look() != before:
            before, since = look(), time.monotonic()


@pytest.fixture
def in_a_window(monkeypatch, tmp_path):
    """As if this Blender had a window, and a driver that says nothing new."""
    platform = SimpleNamespace(**dict.fromkeys(DRIVER, lambda: "software"))
    monkeypatch.setattr(driver_cache, "bpy", SimpleNamespace(app=SimpleNamespace(background=False, build_hash=b"1")))
    monkeypatch.setattr(driver_cache, "gpu", SimpleNamespace(init=None, platform=platform))
    monkeypatch.setattr(driver_cache, "user_folder", lambda name: tmp_path / name)
    driver_cache.reset()
    driver_cache._name.cache_clear()
    yield platform
    driver_cache.reset()
    driver_cache._name.cache_clear()
    view_worker.shared().drop()
    helper.close()


def precompile(scene):
    until = time.monotonic() + SECONDS
    while driver_cache.is_due(scene):
        driver_cache.step(scene)
        assert time.monotonic() < until
        time.sleep(0.01)


def test_what_was_compiled_once_is_not_waited_for_again(scene, in_a_window):
    if not hasattr(gpu, "init"):
        pytest.skip("Blender draws without a window from 5.2 on")
    precompile(scene)
    driver_cache.reset()
    assert not driver_cache.is_due(scene), "the next session"
    scene.render.resolution_y = 64
    assert driver_cache.is_due(scene), "edges that are powers of two"
    scene.render.resolution_y = 48
    driver_cache._name.cache_clear()
    in_a_window.version_get = lambda: "newer"
    assert driver_cache.is_due(scene), "another driver"
    in_a_window.vendor_get = lambda: "NVIDIA Corporation"
    assert driver_cache.is_due(scene)
    in_a_window.backend_type_get = lambda: "OPENGL"
    assert not driver_cache.is_due(scene), "it would not find what the other Blender has compiled"


def test_where_none_can_compile_the_window_does(scene, in_a_window, monkeypatch):
    """As in Blenders before 5.2, which have no graphics without a window."""
    monkeypatch.setattr(view_worker, "programs_of", lambda _film: {"programs": []})
    precompile(scene)
    assert driver_cache._is_refused and not list(driver_cache.user_folder(driver_cache.FOLDER).glob("*"))
    scene.view_settings.view_transform = "AgX"
    tables = turns(view_worker.shared(), tables_of(view_settings(scene)))
    assert len(list(tables)) == 2, "tables are made as before"


def test_one_that_takes_for_ever_is_not_waited_for(scene, in_a_window, monkeypatch):
    monkeypatch.setattr(driver_cache, "SECONDS", 0.0)
    precompile(scene)
    assert driver_cache._is_refused and not helper.shared().is_running
