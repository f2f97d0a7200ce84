"""docs/bench/README.md is the table of the figures beside it, and figures made elsewhere are taken into it."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def load():
    spec = importlib.util.spec_from_file_location("gpu", ROOT / "scripts/bench/gpu.py")
    gpu = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(gpu)
    return gpu


def test_table_of_gpu_benchmarks_is_up_to_date():
    kept = ROOT / "docs/bench"
    assert list(kept.glob("*.json"))
    assert (kept / "README.md").read_text() == load().table(kept)


def test_figures_are_kept_where_only_tests_had_no_time(tmp_path, monkeypatch, capsys):
    gpu, code = load(), {}

    def run(*_, **__):
        (tmp_path / "bench-gpu.json").write_text("[]")
        return subprocess.CompletedProcess([], code["of the script"])

    monkeypatch.setattr(gpu.subprocess, "run", run)
    code["of the script"] = 3
    assert gpu.measure("gpu", False, tmp_path) == []
    assert "before all tests had run" in capsys.readouterr().out
    code["of the script"] = 1
    with pytest.raises(SystemExit):
        gpu.measure("gpu", False, tmp_path)


def test_figures_of_a_card_are_taken_from_a_file(tmp_path, monkeypatch):
    gpu = load()
    wanted = next(goal for goal in gpu.GOALS if "256/8" in goal["what"])
    fields = dict.fromkeys(("peer", "peer_value", "ratio", "limit", "share_of_limit"))
    fields |= {"unit": "ms", "adapter": "A card", "date": "2027-01-02", "goal": 3.0}
    # By matrices where there are such, or else by the plain kernel.
    figures = zip(wanted["names"], (1.25, 7.5), strict=True)
    records = [fields | {"name": name, "value": value} for name, value in figures]
    (tmp_path / "from.json").write_text(json.dumps(records[::-1]))
    monkeypatch.setattr(gpu, "KEPT", tmp_path / "kept")
    words = ["--from", tmp_path / "from.json", "--keep", "card", "--out", tmp_path / "out"]
    monkeypatch.setattr(sys, "argv", ["gpu.py", *map(str, words)])
    gpu.main()
    text = (tmp_path / "kept/README.md").read_text()
    assert "No graphics card" not in text and "A card, 2027-01-02" in text
    row = next(line for line in text.splitlines() if line.startswith(f"| {wanted['what']} |"))
    assert row.endswith("| 1.25 ms |") and "3 ms" in row and "9.13 ms" in row
    assert "7.5 ms, goal 3" in text and text.count("not measured") == len(gpu.GOALS) - 1
