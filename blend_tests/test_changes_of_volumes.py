"""Volumes that have changed since the bake are noticed: their files, settings and frames."""

import bpy
import numpy as np
import pytest
from vdb_file import write_vdb

from addon.engine.staleness import volume_fingerprints
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_quad, said, update


@pytest.fixture
def smoky(lit, tmp_path):
    """A bake of a volume whose files are a sequence of three frames; returns the volume."""
    for frame in (1, 2, 3):
        write_vdb(tmp_path / f"smoke_{frame:04d}.vdb", {"density": np.full((4, 4, 4), float(frame))})
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath = str(tmp_path / "smoke_0001.vdb")
    volume.is_sequence, volume.frame_start, volume.frame_duration = True, 1, 3
    add(lit, "Smoke", volume)
    lit.frame_set(2)
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(lit) == []
    return volume


def test_a_file_that_changes_on_disk_is_named(lit, smoky, tmp_path):
    write_vdb(tmp_path / "smoke_0003.vdb", {"density": np.ones((5, 5, 5))})
    assert scheduler.look_at_files()
    assert said(lit) == []
    write_vdb(tmp_path / "smoke_0002.vdb", {"density": np.ones((5, 5, 5))})
    scheduler.look_at_files()
    assert said(lit) == ["The file of volume 'Smoke' changed"]


def test_another_frame_is_named_until_the_one_of_the_bake_is_back(lit, smoky):
    lit.frame_set(3)
    assert said(lit) == ["The file of volume 'Smoke' changed"]
    lit.frame_set(2)
    assert said(lit) == []


@pytest.mark.parametrize("setting, value", [("clipping", 0.5), ("space", "WORLD")])
def test_settings_that_renders_heed_are_named(lit, smoky, setting, value):
    setattr(smoky.render, setting, value)
    assert said(lit) == ["Settings of volume 'Smoke' changed"]


def test_a_view_layer_that_leaves_volumes_out_is_named(lit, smoky):
    bpy.context.view_layer.use_volumes = False
    assert said(lit) == ["The view layer shows volumes, or no longer does"]


def test_smoke_of_another_frame_is_named(lit, smoky, monkeypatch):
    # Blender's module has no simulation, and ends where a domain is rendered.
    monkeypatch.setattr(volume_fingerprints, "smoke_domain", lambda obj: obj.name == "Domain")
    add_quad(lit, "Domain").modifiers.new("Bevel", "BEVEL")
    update()
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(lit) == []
    lit.frame_set(3)
    assert "The smoke of 'Domain' is that of another frame" in said(lit)
