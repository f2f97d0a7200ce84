"""How far work is, in words."""

import pytest

from addon.core import progress


@pytest.mark.parametrize(
    "report, said",
    [
        ({"done": 1, "total": 4, "remaining_s": 65.0}, (0.25, "25 %, 1:05 left")),
        ({"done": 1, "total": 4, "remaining_s": None}, (0.25, "25 %")),
        ({"done": 0, "total": 0}, (0.0, "0 %")),
        ({"done": 9, "total": 4, "remaining_s": 0.0}, (1.0, "100 %, 0:00 left")),
        ({"done": 1, "total": 1000, "remaining_s": 3661.0}, (0.001, "0 %, 1:01:01 left")),
    ],
)
def test_share_and_words(report, said):
    assert progress.share_and_words(report) == said


def test_the_pace_is_that_of_the_steps_so_far(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    pace = progress.Pace()
    assert pace.remaining(0, 8) is None
    now[0] += 6.0
    assert pace.remaining(2, 8) == 18.0
    assert pace.remaining(8, 8) == 0.0
