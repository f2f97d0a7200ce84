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
    assert run.play_all(room, [run.Part(scenario)], 1.0) == ([], well)
    verdict = "skipped" if well else "FAILED"
    assert f"window: hall: {verdict}, hall.blend is not in {scenes}" in capsys.readouterr().out


SCENARIOS = {"long": "FIRST = True\nON_VULKAN = True\n", "plain": "", "slow": "BY_NAME = True\n"}


@pytest.mark.parametrize(
    ("names", "on_vulkan", "played"),
    [
        ([], False, ["long", "long-vulkan", "plain"]),
        ([], True, ["long-vulkan", "plain-vulkan"]),
        (["slow", "long"], False, ["slow", "long"]),
        (["slow"], True, ["slow-vulkan"]),
    ],
)
def test_what_is_played(tmp_path, names, on_vulkan, played):
    paths = {name: tmp_path / f"{name}.py" for name in sorted(SCENARIOS)}
    for name, path in paths.items():
        path.write_text(SCENARIOS[name])
    assert [part.name for part in run.chosen_parts(paths, names, on_vulkan)] == played


def test_maps_of_memory_are_as_many_as_vulkan_takes_while_it_is_played(tmp_path, monkeypatch, capsys):
    limit = tmp_path / "max_map_count"
    limit.write_text("65530\n")
    monkeypatch.setattr(run, "MAPS", limit)
    plain, vulkan = run.Part(Path("a.py")), run.Part(Path("a.py"), "vulkan")
    with run.enough_maps([plain]) as parts:
        assert (parts, limit.read_text()) == ([plain], "65530\n")
    with run.enough_maps([plain, vulkan]) as parts:
        assert (parts, int(limit.read_text())) == ([plain, vulkan], run.MAPS_NEEDED)
    assert limit.read_text() == "65530\n"
    monkeypatch.setattr(Path, "write_text", lambda *_: (_ for _ in ()).throw(PermissionError("no right")))
    with run.enough_maps([plain, vulkan]) as parts:
        assert parts == [plain]
    assert "Vulkan is skipped" in capsys.readouterr().out
