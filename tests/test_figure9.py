"""What is printed beside each other in figure 9 was measured on the same runs, and says its steps."""

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "scripts/bench/solve")]

import figure9  # noqa: E402
from records import Records  # noqa: E402


def record(method, run, steps, error):
    """A run that gets to its error after a hundredth of a second a step, and of an error of 1 before."""
    through = figure9.MITSUBA if method == "Mitsuba" else "auto"
    same = {"table": "9", "scene": "box", "size": 128, "samples": 16, "bake_samples": 64, "psnr": 30.0, "threads": 1}
    result = {"parameter_error": error, "seconds": steps / 100, "trajectory": [[0.0, 1.0], [steps / 100, error]]}
    return same | result | {"method": method, "through": through, "bake_seconds": 5.0, "run": run, "steps": steps}


def shown(tmp_path, capsys, found):
    """The lines of the table."""
    records = Records(tmp_path / "records.json")
    records.all = found
    figure9.show(records)
    return capsys.readouterr().out.splitlines()[2:]


def test_methods_are_compared_over_the_runs_that_both_have(tmp_path, capsys):
    found = [record("relume gather", run, 500, error) for run, error in enumerate((0.1, 0.2, 0.9))]
    found += [record("Mitsuba", run, 1000, 0.3) for run in (0, 1, 7)]
    ours, theirs, factor = shown(tmp_path, capsys, found)
    assert "500 steps   2 runs  error 0.1500" in ours
    assert "1000 steps   2 runs  error 0.3000" in theirs
    assert "one thread" in ours and "one thread" in theirs
    assert "lower final error in 2 of 2 runs; Mitsuba's best error of 1000 steps 2.0 x sooner" in factor
    assert "1.0 x where the bake of 5 s, which serves every solve, is counted" in factor


def test_a_method_alone_has_all_its_runs(tmp_path, capsys):
    (line,) = shown(tmp_path, capsys, [record("relume gather", run, 500, 0.1) for run in range(3)])
    assert "500 steps   3 runs" in line


def test_runs_of_other_threads_are_not_compared(tmp_path, capsys):
    found = [record("relume gather", 0, 500, 0.1), record("Mitsuba", 0, 500, 0.3) | {"threads": 0}]
    ours, theirs = shown(tmp_path, capsys, found)
    assert "one thread" in ours and "all cores" in theirs
