"""The window tests' watch sees what takes long, and takes nothing itself that it would then see."""

import gc
import mmap
import sys
from pathlib import Path

import pytest

if not hasattr(sys, "monitoring"):
    pytest.skip("Python has sys.monitoring from 3.12 on", allow_module_level=True)
sys.path.append(str(Path(__file__).parent / "window"))
import watch as module  # noqa: E402

CODE = """
import gc

def small(x):
    return x + 1

def many(count):
    for x in range(count):
        small(x)

def numbers(count):
    for x in range(count):
        yield small(x)

def listed():
    return list(zip(numbers(300), numbers(300)))

def fails():
    raise ValueError

def collects():
    gc.collect()

def touches(memory, pages):
    for page in range(pages):
        memory[page * 4096] = 1

def outer():
    many(1000)
    listed()
    try:
        fails()
    except ValueError:
        pass
"""


@pytest.fixture
def watched(tmp_path):
    """A watch of a folder with a module in it, and that module's functions."""
    path = tmp_path / "code.py"
    names = {}
    exec(compile(CODE, str(path), "exec"), names)
    watch = module.Watch(tmp_path)
    yield watch, names
    gc.callbacks.remove(watch._collect)
    sys.monitoring.set_events(module.TOOL, 0)
    sys.monitoring.free_tool_id(module.TOOL)


def test_small_functions_that_are_called_often_are_seen_a_few_times_only(watched, monkeypatch):
    watch, names = watched
    seen = []
    frame_of = module._frame_of
    monkeypatch.setattr(module, "_frame_of", lambda code: (seen.append(code.co_name), frame_of(code))[1])
    names["outer"]()
    assert seen.count("small") <= 3 * module.MANY, "its beginnings and ends"
    assert (watch.calls, watch.longest.name) == (1, "outer")
    assert not watch._open, "all that began has ended"


def test_functions_that_blender_itself_calls_are_always_seen(watched):
    watch, names = watched
    for x in range(3 * module.MANY):
        names["small"](x)
    assert watch.calls == 3 * module.MANY
    watch.reset()
    names["many"](10)
    assert (watch.calls, watch.longest.name, watch.longest.inner.name) == (1, "many", "small")


def test_a_step_begins_with_everything_in_sight(watched):
    watch, names = watched
    names["outer"]()
    watch.reset()
    names["small"](1)
    assert watch.longest.name == "small"


def test_collecting_garbage_is_not_taken_for_the_call_that_it_falls_into(watched):
    watch, names = watched
    names["collects"]()
    (what, seconds), *others = watch.longest.of_blender.items()
    assert (what, others) == ("Python collects garbage", [])
    assert 0.5 * watch.longest.processor < seconds <= watch.longest.processor
    assert watch.longest.own == watch.longest.processor - seconds


def test_memory_that_is_touched_for_the_first_time_is_counted(watched):
    watch, names = watched
    with mmap.mmap(-1, 4096 * 2000) as memory:
        memory.madvise(mmap.MADV_NOHUGEPAGE)
        names["touches"](memory, 2000)
        first = watch.longest
        watch.reset()
        names["touches"](memory, 2000)
    again = watch.longest
    assert first.of_machine.pages >= 2000 > 200 > again.of_machine.pages
    watch.end_turn()
    assert watch.longest_turn.of_machine == again.of_machine
