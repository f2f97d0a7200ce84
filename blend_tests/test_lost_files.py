"""Files of a bake that are gone when its .blend file is opened again are said by name."""

import bpy
import pytest

from addon.core import status
from addon.core.bake_folder import CONTENTS
from addon.engine.shot import options, shot
from addon.live import handlers
from addon.ui.start import start
from helpers import settled, until

WEIGHTS, MEASURED = "proxy_facing-disk.safetensors", "proxy_facing-disk.json"
TRAINING, GUIDED = "training_facing-disk.safetensors", "guided.json"


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


LOST = [
    ([WEIGHTS], f"{WEIGHTS} is missing in"),
    ([MEASURED], f"{MEASURED} is missing in"),
    ([WEIGHTS, MEASURED, TRAINING], f"{WEIGHTS} and {MEASURED} are missing in"),
    ([GUIDED], f"{GUIDED} is missing in"),
]


@pytest.mark.parametrize("lost, said", LOST)
def test_what_a_bake_lacks_is_named_and_made_again(learned, lost, said):
    folder, reopen = learned
    for name in lost:
        (folder / name).unlink()
    scene = reopen()
    found = until(scene, settled, "the bake")
    (note,) = notes_of_files(found, folder)
    assert note.startswith(said) and "Rebake" in note
    if lost != [GUIDED]:
        assert status.shown(found.status).startswith("Showing 16 samples") and not found.status["proxies"]
    options.preferences().train_seconds = 1.0
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    found = until(scene, lambda found: found.status["proxies"] and settled(found), "what was lost")
    assert notes_of_files(found, folder) == [] and all((folder / name).exists() for name in lost)


def test_a_bake_that_does_not_say_what_it_holds_shows_what_it_has(learned):
    folder, reopen = learned
    for name in (CONTENTS, WEIGHTS):
        (folder / name).unlink()
    found = until(reopen(), settled, "the bake")
    assert notes_of_files(found, folder) == [] and found.frame is not None


def test_a_whole_bake_lacks_nothing(learned):
    folder, reopen = learned
    assert notes_of_files(until(reopen(), settled, "the bake"), folder) == []
    (folder / TRAINING).unlink()
    assert notes_of_files(until(reopen(), settled, "the bake"), folder) == [], "nobody needs it any more"
