"""Steps of Blender around a render must not reach a scene that is read: in a Blender of its own, which may crash."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from around_renders import AROUND

from addon.engine.reading.scene import load_scene
from helpers import add_quad

pytestmark = pytest.mark.every_version

SCRIPT = Path(__file__).with_name("around_renders.py")


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Lines of the script on each case, and its exit status with its last errors."""
    command = [sys.executable, SCRIPT, tmp_path_factory.mktemp("around")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=200)
    lines = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    return {line.pop("case"): line for line in lines}, f"{done.returncode}: {done.stderr[-2000:]}"


@pytest.mark.parametrize("case", [case.__name__ for case in AROUND])
def test_reading_a_scene_leaves_no_trace_and_sees_the_same(told, case):
    found, ending = told
    assert case in found, ending
    assert found[case] == {"hash": found["plain"]["hash"], "changed": [], "files": []}


def test_a_render_whose_add_on_goes_away_ends_without_a_picture(told):
    found, ending = told
    assert "disabled" in found, ending
    assert "disabled while it rendered" in found["disabled"]["error"] and not found["disabled"]["files"]


def test_persistent_data_does_not_keep_an_old_scene(scene):
    plane = add_quad(scene)
    scene.render.use_persistent_data = True
    before = load_scene(scene).hash
    plane.location.z = 1.0
    assert load_scene(scene).hash != before
    plane.location.z = 0.0
    assert load_scene(scene).hash == before


def test_a_scene_of_which_no_layer_is_rendered_is_refused(scene):
    add_quad(scene)
    scene.view_layers[0].use = False
    with pytest.raises(RuntimeError, match="No view layer of scene 'Scene' is rendered; switch on"):
        load_scene(scene)
