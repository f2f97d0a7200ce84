"""The exit codes of scripts/gpu-check, with programs that only pretend to test and to measure."""

import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parent.parent / "scripts/gpu-check"
TESTS = [
    "test_relume_gpu",
    "test_relume_gather",
    "test_relume_proxy",
    "test_relume_session",
    "test_gpu",
    "test_devices",
]


@pytest.fixture
def check(tmp_path):
    """Runs the script beside a program that sees a card and tests that pass at once, or do what is given."""
    shutil.copy(SCRIPT, tmp_path)

    def run(seconds, **programs):
        pretended = {"relume": "echo A card"} | dict.fromkeys(TESTS, ":") | programs
        for name, text in pretended.items():
            (tmp_path / name).write_text(f"#!/bin/bash\n{text}\n")
            (tmp_path / name).chmod(0o755)
        words = [tmp_path / "gpu-check", "--device", "card", "--out", tmp_path / "out", "--seconds", str(seconds)]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        return done.returncode, done.stdout

    return run


def test_time_that_is_up_for_tests_alone_is_no_failure(check):
    code, text = check(60)
    assert code == 0 and "all is well" in text
    code, text = check(7, test_relume_session="sleep 30")
    assert code == 3 and "tests-session: not done in" in text and "tests-cli: no time was left" in text


def test_kernels_are_tested_as_they_are_timed(check):
    code, _ = check(60, test_relume_gather='[ -n "$RELUME_GPU_UNCHECKED" ]')
    assert code == 0


def test_what_fails_or_is_not_measured_is_a_failure(check):
    code, text = check(60, test_relume_proxy="exit 4")
    assert code == 1 and "tests-proxy: exit code 4" in text and "tests-gather" in text
    code, text = check(0)
    assert code == 1 and "bench-device: no time was left" in text
