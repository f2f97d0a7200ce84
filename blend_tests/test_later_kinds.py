"""Kinds of light that come into use after all that was asked for of a bake was done."""

from types import SimpleNamespace

import pytest

from addon.core import bake_goal, status
from addon.engine.shot import options, requests, shot
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add_light, settled, until, update


@pytest.fixture
def ready(lit):
    """The fake native module of a shot that was baked."""
    start(lit)
    live = FakeLive.made[-1]
    live.tell(state="ready", samples=4, samples_total=4)
    scheduler.tick()
    return live


def learned(live):
    """How often the fake was asked to learn."""
    return [call for call in live.calls if call[0] == "learn"]


def test_a_kind_that_is_added_later_is_learned_then(studio):
    options.preferences().train_seconds = 1.0
    start(studio)
    is_ready = lambda found: found.status.phase == "ready" and settled(found)  # noqa: E731
    found = until(studio, is_ready, "the proxy of points")
    assert set(found.status.live.proxies) == {"facing-disk"}
    add_light(studio, "AREA", name="Rim")
    update()
    until(studio, lambda found: found.status.phase == "training", "the training of rectangles")
    assert found.status.is_incomplete and bake_goal.read(found.folder) == bake_goal.BakeGoal(16, 1.0)
    until(studio, is_ready, "the proxy of rectangles")
    assert set(found.status.live.proxies) == {"facing-disk", "quad"} and bake_goal.read(found.folder) is None
    assert not any("no proxy has learned" in note for note in found.notes)
    add_light(studio, "SUN", name="Sun")
    update()
    until(studio, is_ready, "the sun, which is never learned")
    assert set(found.status.live.proxies) == {"facing-disk", "quad"}
    assert any("'Sun'" in note and "no proxy has learned" in note for note in found.notes)


def test_it_can_go_on_after_a_cancel(lit, ready):
    ready.tell(unlearned=["quad"])
    scheduler.tick()
    assert learned(ready) == [("learn", 60.0)]
    scheduler.tick()
    ready.cancel()
    scheduler.tick()
    found = shot.of(lit)
    assert status.is_unfinished(found.status)
    assert status.headline(found.status) == "Stopped while learning the lights; 4 samples are kept"


def test_it_is_learned_once_though_its_proxy_cannot_be_read(ready):
    ready.tell(unlearned=["quad"])
    scheduler.tick()
    scheduler.tick()
    ready.tell(state="ready")
    scheduler.tick()
    assert len(learned(ready)) == 1


def test_nothing_is_learned_for_what_is_only_tried(lit, ready):
    found = shot.of(lit)
    found.ask(requests.kept_request('{"lights": []}'))  # As the solver does.
    ready.tell(unlearned=["quad"])
    scheduler.tick()
    assert not learned(ready)
    scheduler.request_picture(lit)
    scheduler.tick()
    assert len(learned(ready)) == 1


def test_it_waits_for_a_job_in_the_same_folder(lit, ready, monkeypatch):
    job = SimpleNamespace(is_running=True, folder=shot.of(lit).folder)
    monkeypatch.setattr("addon.engine.shot.background._jobs", [job])
    ready.tell(unlearned=["quad"])
    scheduler.tick()
    assert not learned(ready)
    job.is_running = False
    scheduler.tick()
    assert len(learned(ready)) == 1


def test_no_time_for_training_means_none(lit):
    options.preferences().train_seconds = 0.0
    start(lit)
    live = FakeLive.made[-1]
    live.tell(state="ready", samples=4, samples_total=4, unlearned=["quad"])
    scheduler.tick()
    assert not learned(live)


def test_a_bake_that_is_opened_alone_is_left_as_it_is(lit, ready):
    shot.Shot.open(lit)
    scheduler.read_lights(lit)
    live = FakeLive.made[-1]
    live.tell(unlearned=["quad"])
    scheduler.tick()
    assert live is not ready and not learned(live)


def test_a_folder_that_cannot_be_written_to_is_said(lit, ready, monkeypatch):
    def full(*_arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bake_goal.BakeGoal, "write", full)
    ready.tell(unlearned=["quad"])
    scheduler.tick()
    assert not learned(ready) and any("is not learned" in note for note in shot.of(lit).notes)
