"""The preferences: what they change, and a clean-up that deletes nothing but bakes."""

import json
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.core import bake_cache, disk
from addon.core.bake_folder import MANIFEST
from addon.engine import devices
from addon.engine.native import NativeModuleError, native
from addon.engine.shot import background, cache, options
from addon.engine.shot.checks import ProblemError, folders_in_use
from addon.ui import preferences, timers
from addon.ui.preferences import RELUME_OT_count_cache
from addon.ui.start import start
from fake_live import FakeLive

pytestmark = pytest.mark.every_version


@pytest.fixture
def chosen(registered, tmp_path):
    """The preferences of the enabled add-on, with a cache folder of their own."""
    preferences = options.preferences()
    preferences.cache_folder = str(tmp_path / "cache")
    return preferences


def make_bake(folder):
    """Writes a folder that looks like a bake."""
    folder.mkdir(parents=True)
    (folder / MANIFEST).write_text(json.dumps({"scene_hash": "", "passes": [], "tile_size": 64}))
    (folder / "tile_0000.safetensors").write_bytes(bytes(1000))


def done(work):
    """The end of what is done a moment at a time."""
    deadline = time.monotonic() + 60
    try:
        while time.monotonic() < deadline:
            next(work)
            time.sleep(0.001)
    except StopIteration as end:
        return end.value
    raise AssertionError("it does not end")


def count_cache():
    return done(cache.count(options.cache_folder()))


def clean_cache():
    return done(cache.clean(options.cache_folder(), folders_in_use))


def test_choices_reach_the_native_module(lit, chosen, monkeypatch):
    chosen.device, chosen.threads, chosen.train_seconds = "cpu", 1, 5.0
    chosen.limit_gpu_memory, chosen.gpu_memory = True, 512
    start(lit)
    live = FakeLive.made[-1]
    folder = str(options.bake_folder(lit))
    assert live.arguments == {"folder": folder, "device": "cpu", "gpu_memory": 512 * 2**20, "threads": 1}
    assert live.calls[0][2] == 5.0 and live.calls[0][1]["threads"] == 1


def test_clean_up_deletes_bakes_only(chosen, tmp_path):
    cache = tmp_path / "cache"
    make_bake(cache / "one")
    make_bake(cache / "two")
    make_bake(cache / "with a letter")
    (cache / "with a letter" / "letter.txt").write_text("mine")
    make_bake(tmp_path / "elsewhere")
    (cache / "photos").mkdir()
    (cache / "photos" / MANIFEST).write_text('{"my": "own"}')
    (cache / "notes.txt").write_text("mine")
    os.symlink(tmp_path / "elsewhere", cache / "link")
    number, size = count_cache()
    assert number == 3 and size > 3000
    gone, problems = clean_cache()
    assert (gone, problems) == (3, [])
    assert sorted(entry.name for entry in cache.iterdir()) == ["link", "notes.txt", "photos", "with a letter"]
    assert [file.name for file in (cache / "with a letter").iterdir()] == ["letter.txt"]
    assert (tmp_path / "elsewhere" / MANIFEST).exists()
    assert count_cache() == (0, 0)


def test_clean_up_keeps_what_is_shown(lit, chosen, tmp_path):
    lit.relume.folder = ""
    found = start(lit)
    assert found.folder.parent == tmp_path / "cache"
    (found.folder / MANIFEST).write_text(json.dumps({"scene_hash": "", "passes": [], "tile_size": 64}))
    gone, problems = clean_cache()
    assert gone == 0 and "in use" in problems[0]
    assert found.folder.exists()


def test_clean_up_keeps_what_is_baked_in_the_background(chosen, tmp_path, monkeypatch):
    make_bake(tmp_path / "cache" / "one")
    job = SimpleNamespace(is_running=True, folder=tmp_path / "cache" / "one")
    monkeypatch.setattr(background, "_jobs", [job])
    gone, problems = clean_cache()
    assert gone == 0 and "in use" in problems[0]
    job.is_running = False
    assert clean_cache() == (1, [])
    background._jobs.clear()


@pytest.fixture
def slow(monkeypatch):
    """Counting and deleting last until this is set."""
    gate = threading.Event()
    for name in ("size_of", "remove"):
        plain = getattr(bake_cache, name)
        monkeypatch.setattr(bake_cache, name, lambda *asked, plain=plain: gate.wait(60) and plain(*asked))
    yield gate
    gate.set()


def test_the_window_goes_on_while_the_cache_is_counted_and_deleted(chosen, tmp_path, slow, monkeypatch):
    make_bake(tmp_path / "cache" / "one")
    monkeypatch.setattr(preferences, "POLL_SECONDS", 0.0)
    for work, said in (
        (preferences.count_cache, [("INFO", "Counted 1 bake, 1 kB")]),
        (preferences.clean_cache, [("INFO", "Deleted 1 bake")]),
    ):
        preferences._work = work()
        assert all(preferences.step() for _ in range(5)) and not RELUME_OT_count_cache.poll(None)
        slow.set()
        while preferences.step():
            time.sleep(0.001)
        assert preferences._messages == said and RELUME_OT_count_cache.poll(None)
        slow.clear()


def test_nothing_is_baked_where_a_bake_is_being_deleted(lit, chosen, tmp_path, slow):
    folder = tmp_path / "cache" / "one"
    make_bake(folder)
    make_bake(tmp_path / "cache" / "two")
    work = cache.clean(tmp_path / "cache", folders_in_use)
    while folder not in cache.going():
        next(work)
    lit.relume.folder = str(folder)
    with pytest.raises(ProblemError, match="being deleted by Clean Up"):
        start(lit)
    lit.relume.folder = str(tmp_path / "cache" / "two")
    start(lit)  # Its turn has not come.
    slow.set()
    gone, problems = done(work)
    assert gone == 1 and "'two' is in use" in problems[0] and cache.going() == set()


def test_files_that_go_while_they_are_counted_do_not_matter(tmp_path, monkeypatch):
    make_bake(tmp_path / "one")
    (tmp_path / "one" / "tile_0000.safetensors.part").write_bytes(bytes(9))
    plain = Path.lstat

    def lstat(path):
        if path.suffix == ".part":
            raise FileNotFoundError(path)
        return plain(path)

    monkeypatch.setattr(Path, "lstat", lstat)
    assert bake_cache.size_of(tmp_path / "one") > 1000


def test_a_missing_cache_folder_is_empty(chosen):
    assert count_cache() == (0, 0) and clean_cache() == (0, [])
    assert bpy.ops.relume.count_cache() == {"FINISHED"}
    assert bpy.ops.relume.clean_cache() == {"FINISHED"}


def test_devices_are_found(chosen):
    assert bpy.ops.relume.find_devices() == {"FINISHED"}
    deadline = time.monotonic() + 60
    while devices.is_looking():
        assert time.monotonic() < deadline, "looking for devices does not end"
        time.sleep(0.01)
    assert devices.names()[:3] == ["auto", "cpu", "gpu"]


def test_a_native_module_of_another_version_is_refused(monkeypatch):
    import relume

    assert native() is relume
    monkeypatch.setattr(relume, "__version__", "0.0.1")
    with pytest.raises(NativeModuleError, match="restart Blender"):
        native()


def test_timers_of_windows_go_with_the_add_on():
    added, removed = [], []

    class Manager:
        def event_timer_add(self, seconds, window):
            added.append((seconds, window))
            return object()

    manager = Manager()
    one, two = (timers.begin(SimpleNamespace(window_manager=manager, window="window"), 0.1) for _ in range(2))
    context = SimpleNamespace(window_manager=SimpleNamespace(event_timer_remove=removed.append))
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(timers, "bpy", SimpleNamespace(context=context))
        timers.end(one)
        timers.unregister()
        timers.end(two)
    assert added == [(0.1, "window")] * 2 and removed == [one, two]


def test_sizes_in_words():
    assert [disk.in_words(size) for size in (0, 1500, 2_500_000, 3_400_000_000)] == [
        "0 kB",
        "2 kB",
        "2.5 MB",
        "3.4 GB",
    ]
