"""The disk is full while lights are learned: that is said, what was learned before stays, and pictures go on."""

import os
import subprocess
import sys
import time

import bpy
import pytest

from addon.core import status
from addon.core.bake_folder import is_bake
from addon.engine.shot import background, options, shot
from addon.live.scheduler import TICK_SECONDS, scheduler
from addon.ui import background as ui
from addon.ui.start import open_bake, start
from helpers import SECONDS, settled, until, update

PROXY = "proxy_facing-disk.safetensors"
"""Proxy of the light of these tests."""
BLOCK = 4096


@pytest.fixture
def disk(tmp_path):
    """A disk of its own, of 64 MiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    if not sys.platform.startswith("linux") or os.geteuid() != 0:
        pytest.skip("a small disk can be made by root on Linux only")
    mount = ["mount", "-t", "tmpfs", "-o", "size=64m", "tmpfs", str(folder)]
    done = subprocess.run(mount, capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip(f"no right to mount a small disk: {done.stderr.strip()}")
    yield folder
    shot.close_all(SECONDS)
    background.close_all()
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(disk):
    """Leaves no room at all; the file that takes it."""
    path = disk / "filling"
    with pytest.raises(OSError, match="No space left"), path.open("wb", buffering=0) as file:
        while True:
            file.write(bytes(BLOCK))
    assert os.statvfs(disk).f_bavail == 0
    return path


def turn_until(scene, state):
    """Ticks as Blender's timer does, until the work is in a state; also where it fails."""
    deadline = time.monotonic() + SECONDS
    while shot.of(scene).status.phase != state:
        assert time.monotonic() < deadline, shot.of(scene).status
        scheduler.tick()
        time.sleep(TICK_SECONDS)
    return shot.of(scene)


@pytest.fixture
def learned(studio, disk):
    """A bake on the small disk, with a proxy."""
    studio.relume.folder = str(disk / "bake")
    options.preferences().train_seconds = 1.0
    start(studio)
    until(studio, lambda found: found.status.phase == "ready" and settled(found), "the proxy")
    assert (disk / "bake" / PROXY).exists()
    return studio


def test_what_was_learned_stays_and_learning_goes_on_with_room(learned, disk):
    proxy = (disk / "bake" / PROXY).read_bytes()
    options.preferences().train_seconds = 3.0
    start(learned)
    turn_until(learned, "training")
    filling = fill(disk)
    found = turn_until(learned, "failed")
    assert status.headline(found.status).startswith("The disk is full: free some space")
    assert (disk / "bake" / PROXY).read_bytes() == proxy, "nothing half-written takes its place"
    assert not [path for path in (disk / "bake").iterdir() if path.name.startswith(".")]
    assert found.status.live.proxies, "it is used still"
    before = found.frame.image[..., :3].mean()
    bpy.data.lights["Key"].energy *= 2.0
    update()
    deadline = time.monotonic() + SECONDS
    while found.frame.image[..., :3].mean() < 1.9 * before and time.monotonic() < deadline:
        scheduler.tick()
    assert found.frame.image[..., :3].mean() == pytest.approx(2.0 * before, rel=0.01), "pictures go on"
    filling.unlink()
    start(learned)
    found = until(learned, lambda found: found.status.phase == "ready" and settled(found), "the rest")
    assert (disk / "bake" / PROXY).read_bytes() != proxy and not found.status.is_incomplete


def test_a_bake_in_the_background_says_so_too(learned, disk):
    proxy = (disk / "bake" / PROXY).read_bytes()
    shot.close_all(SECONDS)
    options.preferences().train_seconds = 3.0
    job = ui.start(learned)
    deadline = time.monotonic() + SECONDS
    while job.stage["stage"] != "train" and time.monotonic() < deadline:
        ui.tick()
        time.sleep(0.01)
    filling = fill(disk)
    while job.is_running and time.monotonic() < deadline:
        ui.tick()
        time.sleep(0.01)
    assert "No space left" in job.error and "are free on the disk of" in job.error
    assert (disk / "bake" / PROXY).read_bytes() == proxy
    filling.unlink()
    assert is_bake(disk / "bake")
    open_bake(learned)
    found = until(learned, settled, "the bake from before")
    assert "Stopped while learning" in status.headline(found.status), "what is missing is said, with a button to go on"
