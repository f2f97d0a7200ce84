"""The exit codes of scripts/gpu-check, with programs that only pretend to test and to measure."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"
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
    shutil.copy(SCRIPTS / "gpu-check", tmp_path)
    shutil.copy(SCRIPTS / "quality.py", tmp_path)

    def run(seconds, *parts, **programs):
        pretended = {"relume": "echo A card"} | dict.fromkeys(TESTS, ":") | programs
        for name, text in pretended.items():
            (tmp_path / name).write_text(f"#!/bin/bash\n{text}\n")
            (tmp_path / name).chmod(0o755)
        words = [tmp_path / "gpu-check", "--device", "card", "--out", tmp_path / "out", "--seconds", str(seconds)]
        done = subprocess.run([*words, *parts], capture_output=True, text=True, check=False)
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


TRAINS = r"""
errors='{"psnr": 41.5, "smape": 0.02, "ssim": 0.99, "flip": 0.1}'
case " $* " in
*" devices "*) echo A card ;;
*" trace "*) mkdir -p "${@: -7:1}" && echo '{"result": {"width": 64}}' ;;
*" train "*) echo '{"result": {"samples": 5}}' ;;
*" evaluate "*)
    echo "{\"result\": {\"proxies\": [$errors], \"gather\": $errors, \"gather_denoised\": $errors,
        \"reference_noise\": $errors}}" | tr -d '\n'
    ;;
*) exit 9 ;;
esac
echo "$@" >>"$(dirname "$0")/said"
"""


def test_quality_is_measured_of_packed_scenes_where_it_is_named(check, tmp_path):
    (tmp_path / "scenes").mkdir()
    for scene in ("box", "hall"):
        (tmp_path / f"scenes/{scene}.scene").touch()
    options = ("--quality", "--width 64 --seconds 7 --types sphere --networks fast")
    code, text = check(60, "quality-hall", *options, relume=TRAINS)
    assert code == 0 and "all is well" in text, text
    assert not (tmp_path / "out/box").exists()
    records = json.loads((tmp_path / "out/hall/quality.json").read_text())
    proxy, noise = records[0], records[-1]
    assert (proxy["scene"], proxy["train_seconds"], proxy["samples"], proxy["psnr"]) == ("hall", 7, 5, 41.5)
    assert (noise["network"], noise["reference_samples"]) == ("reference_noise", 4096)
    said = (tmp_path / "said").read_text()
    assert "--device card train" in said and said.count("hall.scene") == 2
    # Of all scenes; not if it is not named; nor of a scene that there is not, or that is of another size.
    assert check(60, "quality", *options, relume=TRAINS)[0] == 0
    assert (tmp_path / "out/box/quality.json").exists()
    assert "== quality" not in check(60)[1]
    assert check(60, "quality-attic", relume=TRAINS)[0] == 1
    code, text = check(60, "quality-box", relume=TRAINS)
    assert code == 1 and "64 pixels wide, not 680" in text
