"""Offers and words of the first panel after a file was opened."""

import shutil
import time
from types import SimpleNamespace

import bpy
import pytest

from addon.core import bake_goal, status
from addon.core.bake_folder import MANIFEST
from addon.core.polled_cache import PolledCache
from addon.engine.shot import options, shot
from addon.live import handlers
from addon.live.scheduler import scheduler
from addon.ui import main_panel
from addon.ui.start import start
from fake_live import FakeLive
from helpers import until


class Layout:
    """Takes all that is drawn, and keeps words and buttons, and both as they follow each other."""

    def __init__(self):
        self.words, self.buttons, self.lines = [], [], []

    def label(self, text="", icon="NONE"):
        self.words.append(text)
        self.lines.append(text)

    def operator(self, name, text=None, icon="NONE"):
        words = bpy.ops
        for part in name.split("."):
            words = getattr(words, part)
        self.buttons.append(text or words.get_rna_type().name)
        self.lines.append(self.buttons[-1])
        return SimpleNamespace()

    def row(self, **_settings):
        return self

    box = column = row

    def prop(self, *_arguments, **_settings):
        pass

    def progress(self, **_settings):
        pass


@pytest.fixture
def drawn(monkeypatch):
    """Draws the panel of a scene."""

    def draw(scene):
        layout = Layout()
        monkeypatch.setattr(main_panel, "message", lambda layout, text, *_icon: layout.label(text))
        monkeypatch.setattr(main_panel.viewport, "prepare", lambda _scene: None)
        view = SimpleNamespace(region_3d=SimpleNamespace(view_perspective="CAMERA"))
        main_panel.RELUME_PT_main.draw(SimpleNamespace(layout=layout), SimpleNamespace(scene=scene, space_data=view))
        return layout

    return draw


def test_a_stopped_bake_that_is_opened_again_can_go_on(studio, tmp_path, drawn):
    studio.relume.samples = 4096
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    until(studio, lambda found: found.status.live.samples > 0 and found.is_recorded, "samples").cancel()
    found = until(studio, lambda found: found.status.phase == "cancelled", "the end")
    assert 0 < found.status.live.samples < 4096 and "Resume" in drawn(studio).buttons
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    handlers.open_bakes()
    scene = bpy.context.scene
    found = until(scene, lambda found: found.status.phase == "ready" and found.frame is not None, "the bake")
    layout, kept = drawn(scene), found.status.live.samples
    assert "Resume" in layout.buttons and layout.words[0] == f"Stopped at {kept} of 4096 samples; they are kept"
    scene.relume.samples = 1
    assert bpy.ops.relume.go_on() == {"FINISHED"}
    found = until(scene, lambda found: found.status.live.samples > kept, "more samples")
    assert found.status.samples_total == 4096, "the quality that it was started with"


def test_a_bake_that_lost_its_manifest_and_one_that_was_moved_are_told_apart(studio, tmp_path, drawn, monkeypatch):
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    folder = until(studio, lambda found: found.status.phase == "ready", "the bake").folder
    bpy.ops.wm.save_mainfile()
    shot.close_all()

    def panel():
        bpy.ops.wm.open_mainfile(filepath=str(path))
        handlers.open_bakes()
        assert shot.of(bpy.context.scene) is None
        monkeypatch.setattr(main_panel, "_disk", PolledCache(1e9))
        drawn(bpy.context.scene)
        while main_panel._disk.is_pending:
            time.sleep(0.001)
        return drawn(bpy.context.scene)

    (folder / MANIFEST).unlink()
    layout = panel()
    assert f"manifest.json is missing or damaged in {folder}" in layout.words and "Find Bake" in layout.buttons
    shutil.rmtree(folder)
    layout = panel()
    assert f"The bake is not where it was: {folder}" in layout.words and "Find Bake" in layout.buttons


@pytest.mark.parametrize("end", ["cancelled", "died"])
def test_a_bake_that_was_stopped_in_its_first_training_can_go_on(studio, tmp_path, drawn, end):
    """The manifest speaks of the 64 samples of that training only."""
    studio.relume.samples, options.preferences().train_seconds = 96, 600.0
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    start(studio)
    found = until(studio, lambda found: found.status.phase == "training" and found.is_recorded, "the training")
    assert found.status.live.samples == 64
    if end == "cancelled":
        found.cancel()
        until(studio, lambda found: found.status.phase == "cancelled", "the end")
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=str(path))
    options.preferences().train_seconds = 0.0
    handlers.open_bakes()
    scene = bpy.context.scene
    until(scene, lambda found: found.status.phase == "ready" and found.frame is not None, "the bake")
    layout = drawn(scene)
    assert "Resume" in layout.buttons and layout.words[0] == "Stopped at 64 of 96 samples; they are kept"
    assert bpy.ops.relume.go_on() == {"FINISHED"}
    found = until(scene, lambda found: found.status.phase == "training", "the training of all samples")
    assert found.status.live.samples == 96
    found.cancel()
    until(scene, lambda found: found.status.phase == "cancelled", "the end")
    layout = drawn(scene)
    assert "Resume" in layout.buttons
    assert layout.words[0] == "Stopped while learning the lights; 96 samples are kept"


def test_what_a_whole_bake_was_to_become_is_forgotten(lit, tmp_path, drawn):
    start(lit)
    assert bake_goal.read(tmp_path / "bake") == bake_goal.BakeGoal(64, 60.0)
    FakeLive.made[-1].tell(state="cancelled", samples=64, samples_total=64)
    scheduler.tick()
    assert "Resume" in drawn(lit).buttons and bake_goal.read(tmp_path / "bake") is not None
    assert bpy.ops.relume.go_on() == {"FINISHED"}
    FakeLive.made[-1].tell(state="ready", samples=64, samples_total=64)
    scheduler.tick()
    assert "Resume" not in drawn(lit).buttons and bake_goal.read(tmp_path / "bake") is None


def test_a_whole_bake_is_ready(lit, drawn):
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=64, samples_total=64)
    FakeLive.made[-1].show()
    scheduler.tick()
    layout = drawn(lit)
    assert "Resume" not in layout.buttons and layout.words[0] == "Ready, 64 samples"
    assert not status.is_unfinished(shot.of(lit).status)


def test_a_bake_that_cannot_be_opened_with_its_file_is_said(lit, tmp_path, drawn, monkeypatch, capfd):
    (tmp_path / "bake").mkdir()
    (tmp_path / "bake" / MANIFEST).write_text('{"scene_hash": "", "passes": [], "tile_size": 64}')

    def fail(_scene):
        raise RuntimeError("Relume was updated\nwhile it was loaded")

    with monkeypatch.context() as patched:
        patched.setattr(shot.Shot, "open", fail)
        handlers.open_bakes()
    says = "The bake of this scene could not be opened: Relume was updated while it was loaded"
    assert says in drawn(lit).words and "Traceback" not in capfd.readouterr().err
    handlers.open_bakes()
    assert shot.of(lit) is not None and says not in drawn(lit).words
    shot.close_all()
    assert says not in drawn(lit).words


def test_hundreds_of_warnings_are_a_line_that_unfolds(lit, drawn):
    start(lit)
    shot.of(lit).warnings += [f"light 'Lamp {number}': out of reach of 'Sofa {number}'" for number in range(300)]
    lit.relume.show_warnings = True
    words = drawn(lit).words
    assert words[-1] == "300 lights: out of reach of" and "Lamp 0, Sofa 0" not in words
    assert bpy.ops.relume.unfold_warnings(kind=words[-1]) == {"FINISHED"}
    words = drawn(lit).words
    assert "Lamp 0, Sofa 0" in words and words[-1] == f"and {300 - main_panel.MOST_WARNINGS} more" and len(words) < 40


def test_warnings_are_grouped_by_what_they_say(lit, drawn):
    start(lit)
    lit.relume.show_warnings = True
    few = "its direct light is found by one path in {} pixels and will be noise; make it larger, or bake more samples"
    notes = [f"light 'Lamp {number}': {few.format(number)}" for number in (40, 7, 190, 7, 12)]
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4, warnings=[*notes, "the file is old"])
    scheduler.tick()
    assert shot.of(lit).notes[0] == (
        f"light 'Lamp 40', and likewise 'Lamp 7', 'Lamp 190' and 'Lamp 12': {few.format('7 to 190')}"
    )
    words = drawn(lit).words
    assert f"4 lights, each: {few.format('7 to 190')}" in words and words[-1] == "the file is old"


def tracing(samples, total, seconds_each):
    """Stage of tracing, as the native module tells it."""
    left = (total - samples) * seconds_each
    return {
        **{"stage": "trace", "done": 100 * samples, "total": 100 * total, "message": ""},
        **{"elapsed_s": samples * seconds_each, "remaining_s": left},
    }


def test_how_long_all_will_take_is_said_while_paths_are_traced(lit, drawn):
    start(lit)
    live = FakeLive.made[-1]
    live.tell(state="baking", samples=4, samples_total=64, stage=tracing(4, 64, 2.0), to_learn=[64])
    live.show()
    scheduler.tick()
    lines = drawn(lit).lines
    # Lines that come and go are below the buttons, which would move under the mouse.
    assert lines.index("At least 3:00 until all is traced and learned") > lines.index("Cancel")
    live.tell(state="ready", samples=64, stage=None, to_learn=[])
    scheduler.tick()
    assert not any("until all is" in words for words in drawn(lit).words)


@pytest.mark.parametrize("samples", [128, 512])
def test_how_long_a_real_bake_will_take_is_said(studio, samples):
    """Lights are learned from 64 samples. That does for twice as many; of more, they are learned again."""
    studio.relume.samples, options.preferences().train_seconds = samples, 1.0
    start(studio)
    told = []

    def is_done(found):
        if (remaining := found.status.remaining) is not None:
            told.append((found.status.stage["stage"], found.status.live.to_learn, remaining))
        return found.status.phase == "ready"

    found = until(studio, is_done, "the end")
    assert found.status.live.samples == samples and status.to_come(found.status) == ""
    assert {"trace", "train", "measure"} <= {name for name, _, _ in told}
    assert told[0][1] == ([64] if samples == 128 else [64, 512])
    for name, to_learn, remaining in told:
        learned = len(to_learn) - (name in {"train", "measure"})
        assert remaining.seconds > learned, "each learning that is still to come takes its time"
        assert remaining.traces == (name == "trace" or to_learn[0] == 64)
        # The time to learn from more samples is not known.
        assert not remaining.is_complete or (name == "measure" and samples == 128)
