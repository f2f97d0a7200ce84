"""The phases of a shot: which may follow which."""

import pytest

from addon.core.phase import BEFORE_BAKE, NEXT, WORKING, IllegalPhaseError, ShotPhase, next_phase

LIVES = [
    "reading preparing baking training baking training ready training ready",
    "reading preparing ready",
    "reading preparing baking cancelled",
    "reading preparing training failed",
    "reading interrupted unread",
    "reading unread",
]


@pytest.mark.parametrize("life", LIVES)
def test_lives_of_shots_are_legal_and_end_closed(life):
    phase, *later = (ShotPhase(word) for word in life.split())
    for new in later:
        assert next_phase(phase, phase) is phase, "the same phase, as most polls find it"
        phase = next_phase(phase, new)
    assert next_phase(phase, ShotPhase.CLOSED) is ShotPhase.CLOSED


@pytest.mark.parametrize(
    "change", ["ready reading", "baking preparing", "unread baking", "closed ready", "failed ready"]
)
def test_other_changes_are_refused(change):
    present, new = map(ShotPhase, change.split())
    with pytest.raises(IllegalPhaseError, match=f"a shot that is {present} cannot become {new}"):
        next_phase(present, new)


def test_every_phase_is_in_the_table_and_can_be_reached():
    reached, edge = {ShotPhase.READING}, {ShotPhase.READING}
    while edge:
        edge = {new for phase in edge for new in NEXT[phase]} - reached
        reached |= edge
    assert set(NEXT) == set(ShotPhase) == reached | {ShotPhase.CLOSED}
    assert not WORKING & {phase for phase, after in NEXT.items() if not after}, "work always ends"
    assert ShotPhase.CANCELLED not in BEFORE_BAKE
