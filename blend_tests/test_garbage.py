"""Python's collecting of garbage while shots are open."""

import gc

import pytest

from addon.engine.shot import shot
from addon.engine.shot.garbage import gc_freeze, gc_unfreeze
from addon.ui.start import start


@pytest.fixture
def nothing_frozen():
    """Garbage collection that nobody has frozen, before and after the test."""
    gc.unfreeze()
    yield
    gc.unfreeze()


def test_what_was_there_before_a_shot_is_not_looked_through(lit, nothing_frozen):
    gc.collect()  # What tests before this one have left.
    before = len(gc.get_objects())
    found = start(lit)
    assert gc.get_freeze_count() >= before > 10 * len(gc.get_objects())
    start(lit)  # In the place of the first.
    assert gc.get_freeze_count() >= before and not found.is_open
    shot.close_all()
    assert gc.get_freeze_count() == 0 and len(gc.get_objects()) >= before


def test_garbage_of_an_open_shot_is_collected(lit, nothing_frozen):
    start(lit)
    circle = []
    circle.append(circle)
    place = id(circle)
    del circle
    assert any(id(found) == place for found in gc.get_objects())
    gc.collect()
    assert not any(id(found) == place for found in gc.get_objects())


def test_what_somebody_else_has_frozen_stays_as_it_is(nothing_frozen):
    gc.freeze()
    count = gc.get_freeze_count()
    later = [[]]
    gc_freeze()
    assert any(found is later for found in gc.get_objects())
    gc_unfreeze()
    assert gc.get_freeze_count() == count
