"""Memory that is found before Blender's main thread touches it."""

import resource
import sys
import threading

import pytest

from addon.core import fresh_memory
from addon.engine import shot
from addon.ui.start import start

SIZE = 32 << 20


@pytest.fixture
def failures(monkeypatch):
    """What threads have raised."""
    found = []
    monkeypatch.setattr(threading, "excepthook", found.append)
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="pages that were touched for the first time are Linux's count")
def test_every_page_is_touched_and_given_back(failures):
    def pages_touched():
        return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

    def pages_held():
        with open("/proc/self/statm") as file:
            return int(file.read().split()[1])

    touched, held = pages_touched(), pages_held()
    fresh_memory.begin_to_find(SIZE).join()
    pages = SIZE // resource.getpagesize()
    assert pages_touched() - touched >= pages and pages_held() - held < pages / 2
    assert failures == []


def test_more_than_there_is_hurts_nobody(failures):
    fresh_memory.begin_to_find(1 << 60).join()
    assert failures == []


def test_a_scene_is_read_when_memory_is_found(lit, monkeypatch):
    found, is_found, read = start(lit), threading.Event(), []
    monkeypatch.setattr(shot, "load_scene_async", lambda scene, *_arguments: read.append(scene))
    found.is_exporting, found._memory = True, threading.Thread(target=is_found.wait)
    found._memory.start()
    assert not found.begin_reading(lit) and read == []
    is_found.set()
    found._memory.join()
    assert found.begin_reading(lit) and read == [lit]
