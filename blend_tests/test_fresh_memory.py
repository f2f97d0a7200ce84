"""Memory that is found before Blender's main thread touches it."""

import inspect
import resource
import sys
import threading
import time

import pytest

from addon.core.fresh_memory import FreshMemory
from addon.engine.reading.render_depsgraph import CONTEXT_BYTES
from addon.engine.shot import shot
from addon.engine.workers import helper, view_worker
from addon.export.view_transform import view_settings
from addon.ui.start import start
from helpers import SECONDS

SIZE = 32 << 20
PAGES = SIZE // resource.getpagesize()


def pages_touched():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def pages_held():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1])


@pytest.mark.skipif(sys.platform != "linux", reason="Linux counts pages that are touched for the first time, and held")
def test_every_page_is_touched_and_held_until_it_is_given_back():
    touched, held = pages_touched(), pages_held()
    memory = FreshMemory(SIZE)
    assert pages_touched() - touched >= PAGES and pages_held() - held >= PAGES
    memory.give_back()
    assert pages_held() - held < PAGES / 2
    memory.give_back()


def test_more_than_there_is_hurts_nobody():
    FreshMemory(1 << 60).give_back()


class Slow:
    """Memory that is found when a test says so."""

    def __init__(self):
        self.is_found, self.seen = threading.Event(), []

    def __call__(self, size):
        self.seen.append(size)
        assert self.is_found.wait(SECONDS)
        return self

    def give_back(self):
        self.seen.append("given back")


@pytest.fixture
def slow(monkeypatch):
    found = Slow()
    for module in (shot, view_worker):
        monkeypatch.setattr(module, "FreshMemory", found)
    yield found
    found.is_found.set()


def test_a_scene_is_read_when_memory_is_there_and_given_back(lit, slow, monkeypatch):
    found = start(lit)
    monkeypatch.setattr(shot, "load_scene_async", lambda *_arguments: slow.seen.append("read"))
    found.is_exporting = True  # As with a window; without one it was read at once.
    assert not found.begin_reading(lit) and not found.begin_reading(lit)
    assert slow.seen == [CONTEXT_BYTES]
    slow.is_found.set()
    until = time.monotonic() + SECONDS
    while not found.begin_reading(lit):
        assert time.monotonic() < until
    assert slow.seen == [CONTEXT_BYTES, "given back", "read"]


def test_a_bake_that_is_cancelled_holds_no_memory(lit, slow):
    found = start(lit)
    found.is_exporting = True
    assert not found.begin_reading(lit)
    found.cancel()
    assert not found.is_exporting and inspect.getgeneratorstate(found._memory) == inspect.GEN_CLOSED


def test_a_table_comes_when_memory_is_there_for_it(scene, slow):
    worker = view_worker.ViewWorker()
    scene.view_settings.view_transform = "AgX"
    worker.ask(view_worker.tables_of(view_settings(scene)))
    until = time.monotonic() + SECONDS
    while not slow.seen:
        assert worker.turn() is None and time.monotonic() < until
        time.sleep(0.01)
    assert worker.turn() is None
    slow.is_found.set()
    while (found := worker.turn()) is None:
        assert time.monotonic() < until
    (entries, _), memory = found
    assert slow.seen == [entries.nbytes] and memory is slow
    helper.close()
