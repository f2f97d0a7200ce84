"""New pictures and new states are drawn at once, mere progress only as often as drawing is cheap."""

from functools import partial
from types import SimpleNamespace

import pytest

from addon.engine.shot import shot
from addon.live import redraws
from addon.live.scheduler import TICK_SECONDS, scheduler
from addon.ui.start import start
from addon.viewport import views
from fake_live import FakeLive

WIDE, NARROW = 2000, 300
"""Widths of a side bar in pixels: all words fit into a line, or 36 characters do."""


@pytest.fixture
def bake(lit, monkeypatch):
    """A bake in progress whose words were drawn, a clock to be set, the width of the side bar, and a list of the
    regions that are drawn from then on."""
    clock = SimpleNamespace(now=100.0, width=WIDE, drawn=[])

    def regions(*kinds):
        return [SimpleNamespace(width=clock.width, tag_redraw=partial(clock.drawn.append, kind)) for kind in kinds]

    monkeypatch.setattr(redraws, "time", SimpleNamespace(perf_counter=lambda: clock.now))
    monkeypatch.setattr(views, "regions", regions)
    found, clock.live = start(lit), FakeLive.made[-1]
    while found.changes.is_pending:
        scheduler.tick()

    def turn(seconds=TICK_SECONDS):
        clock.now += seconds
        scheduler.redraws.note_tick(TICK_SECONDS)
        return scheduler.tick()

    clock.turn = turn
    traced(clock, 1)
    clock.turn()
    clock.turn()
    clock.drawn.clear()
    return clock


def traced(clock, done):
    """The progress is another one."""
    clock.live.tell(stage={"stage": "trace", "done": done, "total": 100, "elapsed_s": 1.0, "remaining_s": None})


def test_progress_takes_its_share_of_the_time_and_the_last_of_it_is_said(bake):
    traced(bake, 2)
    bake.turn(1.0)
    assert bake.drawn == ["UI"]
    slow = 0.2
    traced(bake, 3)
    bake.turn(TICK_SECONDS + slow)
    start, seconds = bake.now, 0.0
    while bake.drawn == ["UI"]:
        assert bake.turn(), "there is something left to be drawn"
        seconds = bake.now - start
        assert seconds < 10.0
    assert seconds == pytest.approx(slow / redraws.SHARE, abs=2 * TICK_SECONDS)
    assert bake.drawn == ["UI", "UI"]


def test_a_picture_is_drawn_at_once(bake):
    for done in (2, 3):
        traced(bake, done)
        bake.turn()
    bake.drawn.clear()
    bake.live.show(serial=1)
    bake.turn()
    assert bake.drawn == ["WINDOW", "UI"]


def test_another_state_is_drawn_at_once_and_again_when_the_panels_have_moved(bake, lit):
    stage = {"stage": "trace", "done": 1, "total": 100, "elapsed_s": 1.0, "remaining_s": 99.0}
    more_is_told = {"stage": stage, "to_learn": [4]}
    for change in (more_is_told, {"paused": True}, {"error": "no space left"}, {"state": "cancelled", "stage": None}):
        bake.drawn.clear()
        bake.live.tell(**change)
        assert bake.turn()
        bake.turn()
        bake.turn()
        assert bake.drawn == ["UI", "UI"], change


def test_panels_move_when_words_take_another_line(bake):
    bake.width = NARROW

    def show(noise):
        """Now it says "Showing 4 samples, denoised (noise 9 % before)", of which 36 characters fit into a line."""
        bake.drawn.clear()
        bake.live.show(serial=bake.live.newest.serial + 1 if bake.live.newest else 1, denoised=True)
        bake.live.state["shown"]["noise"] = noise
        for _ in range(3):
            bake.turn()
        return bake.drawn

    show(None)
    assert show(0.09) == ["WINDOW", "UI", "UI"]
    assert show(0.08) == ["WINDOW", "UI"]


def test_nothing_is_drawn_when_nothing_is_new(bake):
    for _ in range(5):
        bake.turn(1.0)
    assert bake.drawn == []


def test_a_closed_shot_owes_nothing(bake, lit):
    bake.live.tell(paused=True)
    assert bake.turn()
    shot.close_all()
    assert not bake.turn()
