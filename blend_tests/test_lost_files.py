"""Files of a bake that are gone when its .blend file is opened again are said by name."""

import bpy
import pytest

from addon.core import status
from addon.engine import options, shot
from addon.ui import handlers
from addon.ui.start import start
from helpers import settled, until

WEIGHTS, MEASURED = "proxy_facing-disk.safetensors", "proxy_facing-disk.json"
TRAINING = "training_facing-disk.safetensors"


@pytest.fixture
def learned(studio, tmp_path):
    """The folder of a bake whose lights have been learned, and a function that opens its file again."""
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    options.preferences().train_seconds = 1.0
    start(studio)
    until(studio, lambda found: found.status["proxies"] and settled(found) and found.is_recorded, "a proxy")
    bpy.ops.wm.save_mainfile()
    folder = shot.of(studio).folder
    shot.close_all()

    def reopen():
        bpy.ops.wm.open_mainfile(filepath=str(path))
        handlers.open_bakes()
        return bpy.context.scene

    return folder, reopen


def notes_of_files(found, folder):
    return [note for note in found.notes if str(folder) in note]


@pytest.mark.parametrize("lost, named", [([WEIGHTS], WEIGHTS), ([MEASURED], MEASURED), ([WEIGHTS, MEASURED], MEASURED)])
def test_a_proxy_that_lacks_a_file_is_named_and_learned_again(learned, lost, named):
    folder, reopen = learned
    for name in lost:
        (folder / name).unlink()
    scene = reopen()
    found = until(scene, settled, "the bake")
    notes = notes_of_files(found, folder)
    assert [note.split()[0] for note in notes] == lost and named in " ".join(notes)
    assert status.shown(found.status).startswith("Showing 16 samples") and not found.status["proxies"]
    options.preferences().train_seconds = 1.0
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    found = until(scene, lambda found: found.status["proxies"] and settled(found), "what was lost")
    assert notes_of_files(found, folder) == [] and all((folder / name).exists() for name in lost)


def test_a_whole_bake_and_one_that_was_interrupted_lack_nothing(learned):
    folder, reopen = learned
    assert notes_of_files(until(reopen(), settled, "the bake"), folder) == []
    (folder / TRAINING).unlink()
    assert notes_of_files(until(reopen(), settled, "the bake"), folder) == []
    (folder / MEASURED).unlink()  # As while a proxy is made anew.
    shot.of(bpy.context.scene)._owed.note_bake()
    found = until(reopen(), settled, "the bake")
    assert found.status["is_owed"] and notes_of_files(found, folder) == []
