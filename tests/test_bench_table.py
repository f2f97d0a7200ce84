"""The pages of docs/bench are the tables of the figures beside them, and figures made elsewhere are taken into them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


sys.path.insert(0, str(ROOT / "scripts/bench"))

import graphics  # noqa: E402
import live_table  # noqa: E402


@pytest.mark.parametrize(("folder", "table"), [("docs/bench", graphics.table), ("docs/bench/live", live_table.page)])
def test_tables_of_kept_figures_are_up_to_date(folder, table):
    kept = ROOT / folder
    assert list(kept.glob("*.json"))
    assert (kept / "README.md").read_text() == table(kept)


def test_the_page_of_live_figures_has_a_column_for_each_machine(tmp_path):
    about = {"machine": "a CPU", "date": "2027-01-02 03:04", "others": 0.1, "unit": "s", "device": "CPU, 2 threads"}
    first = about | {"name": "first picture, hall", "value": 1.234, "goal": 5, "scale": 2}
    other = about | {"name": "edit, hall", "value": 6.5, "unit": "ms", "goal": None}
    (tmp_path / "one.json").write_text(json.dumps([first, other]))
    (tmp_path / "two.json").write_text(json.dumps([first | {"value": 3.0, "scale": 1}]))
    lines = live_table.page(tmp_path).splitlines()
    assert "| first picture, hall | 5 s | 1.23 s (half the size) | 3 s |" in lines
    assert "| edit, hall |  | 6.5 ms |  |" in lines


def test_figures_are_kept_where_only_tests_had_no_time(tmp_path, monkeypatch, capsys):
    code = {}

    def run(*_, **__):
        (tmp_path / "bench-gpu.json").write_text("[]")
        return subprocess.CompletedProcess([], code["of the script"])

    monkeypatch.setattr(graphics.subprocess, "run", run)
    code["of the script"] = 3
    assert graphics.measure("gpu", False, tmp_path) == []
    assert "before all tests had run" in capsys.readouterr().out
    code["of the script"] = 1
    with pytest.raises(SystemExit):
        graphics.measure("gpu", False, tmp_path)


def test_figures_of_a_card_are_taken_from_a_file(tmp_path, monkeypatch):
    wanted = next(goal for goal in graphics.GOALS if "256/8" in goal["what"])
    fields = dict.fromkeys(("peer", "peer_value", "ratio", "limit", "share_of_limit"))
    fields |= {"unit": "ms", "adapter": "A card", "date": "2027-01-02", "goal": 3.0}
    fields |= {"limit": 0.5, "limit_by": "operations", "share_of_limit": 0.4}
    # By matrices where there are such, or else by the plain kernel.
    figures = zip(wanted["names"], (1.25, 7.5), strict=True)
    records = [fields | {"name": name, "value": value} for name, value in figures]
    (tmp_path / "from.json").write_text(json.dumps(records[::-1]))
    monkeypatch.setattr(graphics, "KEPT", tmp_path / "kept")
    words = ["--from", tmp_path / "from.json", "--keep", "card", "--out", tmp_path / "out"]
    monkeypatch.setattr(sys, "argv", ["graphics.py", *map(str, words)])
    graphics.main()
    text = (tmp_path / "kept/README.md").read_text()
    assert "No graphics card" not in text and "A card, 2027-01-02" in text
    row = next(line for line in text.splitlines() if line.startswith(f"| {wanted['what']} |"))
    assert row.endswith("| 1.25 ms |") and "3 ms" in row and "9.13 ms" in row
    assert "7.5 ms, 40% of 0.5 by operations, goal 3" in text and text.count("not measured") == len(graphics.GOALS) - 1


def test_quality_that_was_measured_elsewhere_stands_beside_the_papers(tmp_path, monkeypatch):
    found = {"width": 885, "reference_samples": 1024, "light_type": "sphere", "date": "2027-01-02"}
    found |= {"smape": 0.02, "ssim": 0.99, "flip": 0.1}
    proxy = found | {"network": "fast", "train_seconds": 300, "samples": 9}
    others = [found | {"network": name, "train_seconds": 0, "psnr": 30.0} for name in ("gather", "reference_noise")]
    files = [tmp_path / "box.json", tmp_path / "hall.json"]
    for file, psnr in zip(files, (41.0, 42.0), strict=True):
        scene = {"scene": file.stem}
        file.write_text(json.dumps([record | scene for record in [proxy | {"psnr": psnr}, *others]]))
    old = {"name": "a figure", "value": 1.0, "unit": "s", "adapter": "A card", "date": "2027-01-01"}
    old |= dict.fromkeys(("peer", "peer_value", "ratio", "limit", "share_of_limit"))
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept/card.json").write_text(json.dumps([old]))
    monkeypatch.setattr(graphics, "KEPT", tmp_path / "kept")
    source, out = tmp_path / "kept/card.json", tmp_path / "out"
    words = ["--from", source, "--quality-from", *files, "--keep", "card", "--out", out]
    monkeypatch.setattr(sys, "argv", ["graphics.py", *map(str, words)])
    for _ in range(2):  # The second time it replaces what is kept.
        graphics.main()
        assert len(json.loads(source.read_text())) == 1 + 2 * len(graphics.QUALITY)
        lines = (tmp_path / "kept/README.md").read_text().splitlines()
        goal = next(line for line in lines if line.startswith("| PSNR after 5 minutes"))
        assert goal.endswith("| 41.5 dB |")
        name = "PSNR of the sphere reference of 1024 samples before it was denoised, 885 wide, box, hall"
        assert lines.count(f"| {name} | 30 dB |") == 1 and any("| a figure | 1 s |" in line for line in lines)
