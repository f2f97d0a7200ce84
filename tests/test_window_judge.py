"""The judge of the window tests takes nothing for granted: what did not provably succeed has failed."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blend_tests" / "window"))
from judge import failures  # noqa: E402

GOOD = {"finished": True, "step": "last", "checks": 3, "failures": [], "expected": []}
TRACE = 'Traceback (most recent call last):\n  File "a.py", line 1, in draw\n    f()\nKeyError: "x"\n'


def test_a_played_scenario_passes():
    assert failures(GOOD, 0, "Blender 5.2\nInfo: Preferences saved\n0 errors\n") == []


@pytest.mark.parametrize(
    ("result", "status", "log", "word"),
    [
        (None, 0, "Blender quit\n", "never started"),
        (GOOD | {"finished": False, "step": "drag"}, 0, "", "in the middle of: drag"),
        (GOOD | {"checks": 0}, 0, "", "checked nothing"),
        (GOOD | {"failures": ["not so"]}, 0, "", "not so"),
        (GOOD, None, "", "time is up"),
        (GOOD, -11, "", "status -11"),
        (GOOD, 0, TRACE + "Blender quit\n", "KeyError"),
        (GOOD, 0, "Blender quit\n" + TRACE[:-13], "Traceback"),
        (GOOD, 0, "Error: Relume needs a camera\n", "needs a camera"),
        (GOOD, 0, "Error: Not freed memory blocks: 2, total unfreed memory 0.000120 MB\n", "blocks: 2"),
        (GOOD | {"errors": ["Relume needs a camera"]}, 0, "", "Blender showed: Relume needs"),
        (GOOD | {"expected": ["no disk"]}, 0, "Error: no disk\nError: no camera\n", "no camera"),
    ],
)
def test_anything_else_fails(result, status, log, word):
    found = failures(result, status, log)
    assert len(found) == 1 and word in found[0], found


def test_expected_errors_pass():
    expecting = GOOD | {"expected": ["no (disk|camera)$"], "errors": ["no camera"]}
    assert failures(expecting, 0, "Error: no disk\n") == []


def test_a_count_of_minus_one_block_passes():
    assert failures(GOOD, 0, "Error: Not freed memory blocks: 4294967295, total unfreed memory 0.000000 MB\n") == []
