"""Python's collecting of garbage while shots are open."""

import gc

import pytest

from addon.engine import garbage, shot
from addon.ui.start import start


@pytest.fixture
def nothing_spared():
    """As in a Blender where nobody spares anything, which is so again afterwards."""
    gc.unfreeze()
    yield
    gc.unfreeze()


def test_what_was_there_before_a_shot_is_not_looked_through(lit, nothing_spared):
    gc.collect()  # What tests before this one have left.
    before = len(gc.get_objects())
    found = start(lit)
    assert gc.get_freeze_count() >= before > 10 * len(gc.get_objects())
    start(lit)  # In the place of the first.
    assert gc.get_freeze_count() >= before and not found.is_open
    shot.close_all()
    assert gc.get_freeze_count() == 0 and len(gc.get_objects()) >= before


def test_garbage_of_an_open_shot_is_collected(lit, nothing_spared):
    start(lit)
    circle = []
    circle.append(circle)
    place = id(circle)
    del circle
    assert any(id(found) == place for found in gc.get_objects())
    gc.collect()
    assert not any(id(found) == place for found in gc.get_objects())


def test_what_somebody_else_spares_stays_as_it_is(nothing_spared):
    gc.freeze()
    count = gc.get_freeze_count()
    later = [[]]
    garbage.spare()
    assert any(found is later for found in gc.get_objects())
    garbage.spare_nothing()
    assert gc.get_freeze_count() == count
