"""The runner of the window tests skips nothing in CI that nobody said may be skipped."""

import contextlib
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts" / "window"))
import run  # noqa: E402


@pytest.mark.parametrize(
    ("variables", "has_folder", "well"),
    [
        ({}, False, True),
        ({}, True, True),
        ({"CI": "1"}, False, False),
        ({"CI": "1"}, True, False),
        ({"CI": "1", "RELUME_WITHOUT_SCENES": "1"}, False, True),
        ({"CI": "1", "RELUME_WITHOUT_SCENES": "1"}, True, False),
        ({"CI": "1", "RELUME_WITHOUT_SCENES": "0"}, False, False),
    ],
)
def test_a_missing_scene(tmp_path, monkeypatch, capsys, variables, has_folder, well):
    for name in ("CI", "RELUME_WITHOUT_SCENES"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    scenes = tmp_path / "scenes"
    if has_folder:
        scenes.mkdir()
    monkeypatch.setattr(run, "SCENES", scenes)
    monkeypatch.setattr(run, "display", lambda _room: contextlib.nullcontext(":1"))
    scenario = tmp_path / "hall.py"
    scenario.write_text('NEEDS = ["hall.blend"]\n')
    (tmp_path / "room" / "scenes").mkdir(parents=True)
    room = SimpleNamespace(folder=tmp_path / "room")
    assert run.play_all(room, [scenario], 1.0) == ([], well)
    verdict = "skipped" if well else "FAILED"
    assert f"window: hall: {verdict}, hall.blend is not in {scenes}" in capsys.readouterr().out
