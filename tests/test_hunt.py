"""The hunt judges pictures by their noise, and names the round that ends Blender."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent

sys.path.insert(0, str(ROOT / "scripts/hunt"))

import hunt  # noqa: E402
import measure  # noqa: E402


def pair(value, noise=0.0, seed=0):
    """Two pictures of 16 x 16 pixels."""
    rng = np.random.default_rng(seed)
    return [value + noise * rng.standard_normal((16, 16, 3)) for _ in range(2)]


@pytest.mark.parametrize(
    ("ours", "cycles", "fault"),
    [
        (pair(1.0), pair(1.05), None),
        (pair(1.0), pair(1.2), "difference"),
        (pair(0.0), pair(0.0), None),
        (pair(1e-3), pair(0.0), "difference"),
        (pair(1.0, noise=2.0), pair(1.12, noise=2.0, seed=1), None),
        (pair(1.0, noise=0.1), pair(1.2, noise=0.1, seed=1), "difference"),
        (pair(np.nan), pair(1.0), "not finite"),
        (pair(1.0), pair(np.nan), None),
    ],
)
def test_a_difference_is_a_fault_where_it_exceeds_the_limit_and_the_noise(ours, cycles, fault):
    found = measure.worst_block(ours, cycles)
    assert (found and found["fault"]) == fault


def test_a_region_is_cut_from_whole_pictures_only():
    render = SimpleNamespace(resolution_x=32, resolution_y=24, use_border=True)
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.0, 0.5
    whole = np.arange(24 * 32).reshape(24, 32)
    part = measure.region(whole, render)
    assert part.shape == (12, 16)
    assert part[0, 0] == whole[12, 8]
    assert measure.region(part, render) is part


@pytest.mark.parametrize(("at", "counts"), [("Relume", True), ("Cycles", False)])
def test_the_round_that_ends_blender_is_found_by_halves(monkeypatch, at, counts):
    played = []

    def play_pictures(hunt, pictures):
        for number, rounds in enumerate(pictures):
            if 61 in rounds:
                return number, [], f"{at}: signal 11"
            played.extend(rounds)
        return len(pictures), [], ""

    monkeypatch.setattr(hunt, "play_pictures", play_pictures)
    faults = hunt.play(hunt.Hunt("4.2", "graphs", seed=1), range(40, 110))
    assert faults == [{"round": 61, "fault": "crash", "said": f"{at}: signal 11"}] * counts
    assert sorted(played) == [number for number in range(40, 110) if number != 61]
