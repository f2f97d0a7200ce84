"""Reads of a disk that is slow, or gone."""

import threading
import time

from addon.core import polled_cache
from addon.core.polled_cache import PolledCache


def wait_for(cache):
    while cache.is_pending:
        time.sleep(0.001)


def test_a_quick_answer_is_there_at_once(monkeypatch):
    monkeypatch.setattr(polled_cache, "WAIT_SECONDS", 10.0)
    assert PolledCache(2.0).get(str.upper, "free") == "FREE"


def test_the_same_is_not_asked_again_before_its_time(monkeypatch):
    monkeypatch.setattr(polled_cache, "WAIT_SECONDS", 10.0)
    looks = []

    def look(folder):
        looks.append(folder)
        return len(looks)

    cache = PolledCache(1e9)
    assert [cache.get(look, folder) for folder in ("a", "a", "b", "a")] == [1, 1, 2, 1]
    assert looks == ["a", "b"]


def test_the_old_answer_stands_until_the_new_one_is_there(monkeypatch):
    monkeypatch.setattr(polled_cache, "WAIT_SECONDS", 10.0)
    may_answer, looks = threading.Event(), []

    def look(_):
        looks.append(1)
        may_answer.wait()
        return len(looks)

    cache = PolledCache(-1.0)
    may_answer.set()
    assert cache.get(look, "folder") == 1
    may_answer.clear()
    assert [cache.get(look, "folder") for _ in range(3)] == [1, 1, 1]
    may_answer.set()
    wait_for(cache)
    cache.max_age_seconds = 1e9
    assert cache.get(look, "folder") == 2


def test_a_disk_that_does_not_answer_is_neither_waited_for_nor_asked_again():
    there, looks = threading.Event(), []

    def look(_):
        looks.append(1)
        there.wait()
        return "here"

    cache = PolledCache(-1.0)
    assert [cache.get(look, "folder") for _ in range(3)] == [None] * 3
    assert cache.is_pending and len(looks) == 1
    there.set()
    wait_for(cache)
    cache.max_age_seconds = 1e9
    assert cache.get(look, "folder") == "here"
