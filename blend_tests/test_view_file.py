"""A bake from the panel holds the scene's view as a headless one does, written while the artist works."""

import numpy as np
import pytest

from addon.engine.shot import shot
from addon.export import write_view_table
from addon.live.scheduler import scheduler
from addon.ui.start import start
from addon.viewport import handlers, view_files
from fake_live import FakeLive
from views import VIEWS

pytestmark = pytest.mark.every_version


@pytest.fixture
def baked(lit, tmp_path, small_tables, monkeypatch):
    """A bake with its first picture, and the place of its view."""
    monkeypatch.setattr(view_files, "SETTLE_SECONDS", 0.0)
    lit.view_settings.view_transform = "AgX"
    (tmp_path / "bake").mkdir()
    start(lit)
    show_picture()
    return lit, tmp_path / "bake" / "view.png"


def show_picture():
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    FakeLive.made[-1].show()
    scheduler.tick()


def let_work(scene):
    """The turns of Blender's window until nothing is left to do; how many it took."""
    handlers._waiting.add(scene.session_uid)
    for turn in range(500):
        if handlers.bake_views() is None:
            return turn
    raise AssertionError("it does not come to an end")


@pytest.mark.parametrize("name", ["AgX", "AgX, exposure and gamma", "AgX, curves", "False Color"])
def test_the_file_is_that_of_a_headless_bake(baked, tmp_path, name):
    scene, path = baked
    VIEWS[name](scene)
    let_work(scene)
    write_view_table(scene, tmp_path / "headless.png")
    assert path.read_bytes() == (tmp_path / "headless.png").read_bytes()


def test_another_view_is_written_anew_and_the_plain_curve_needs_no_file(baked):
    scene, path = baked
    let_work(scene)
    first = path.read_bytes()
    scene.view_settings.exposure = 1.0
    let_work(scene)
    assert path.read_bytes() != first
    scene.view_settings.view_transform, scene.view_settings.exposure = "Standard", 0.0
    let_work(scene)
    assert not path.exists()


def test_nothing_is_written_twice(baked, monkeypatch):
    scene, path = baked
    let_work(scene)
    before = path.stat().st_mtime_ns
    shot.Shot.open(scene)
    show_picture()
    let_work(scene)
    assert path.stat().st_mtime_ns == before, "the bake is opened again, under the same view"
    path.unlink()
    shot.Shot.open(scene)
    show_picture()
    let_work(scene)
    assert path.exists()


def test_a_view_that_changes_meanwhile_is_written_in_the_end(baked, tmp_path):
    scene, path = baked
    handlers._waiting.add(scene.session_uid)
    while not path.exists():
        handlers.bake_views()
    scene.view_settings.exposure = 2.0
    let_work(scene)
    write_view_table(scene, tmp_path / "headless.png")
    assert path.read_bytes() == (tmp_path / "headless.png").read_bytes()


def test_a_folder_that_cannot_be_written_to_is_said_once(baked):
    scene, path = baked
    path.mkdir()
    let_work(scene)
    let_work(scene)
    found = shot.of(scene)
    assert len([note for note in found.notes if "command line" in note]) == 1


def test_until_there_are_samples_there_is_no_file(lit, tmp_path, small_tables, monkeypatch):
    monkeypatch.setattr(view_files, "SETTLE_SECONDS", 0.0)
    lit.view_settings.view_transform = "AgX"
    start(lit)
    let_work(lit)
    assert not (tmp_path / "bake" / "view.png").exists()
    assert np.all([view_files.is_done(shot.of(lit), lit)])
