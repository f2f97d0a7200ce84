"""Strokes in several shots: one solve looks at all of them."""

import json

import bpy
import numpy as np
import pytest
from test_live_views import bake_three

from addon.core import strokes as core
from addon.core.solve import SolveError
from addon.engine.shot import shot, shot_list
from addon.engine.solve import stroke_shots
from addon.engine.solve.request import strokes_of
from addon.ui.solve import operators
from helpers import settled, until

STOPS = 0.5


@pytest.fixture
def painted_three(studio):
    """Three baked shots with a stroke in each, and their keys."""
    bake_three(studio)
    until(studio, lambda _: settled(shot.of(studio)), "the picture")
    keys = [entry.key for entry in studio.relume_shots.items]
    settings = studio.relume_solve
    settings.effort, settings.keep_rest = "QUICK", 0.0
    for key in keys:
        middle = json.dumps([[0.4, 0.5, 1.0], [0.6, 0.5, 1.0]])
        bpy.ops.relume.scribble(points=middle, goal="brighter", amount=STOPS, radius=0.3, shot=key)
    return studio, keys


def test_one_solve_meets_a_stroke_in_each_of_three_shots(painted_three):
    scene, _ = painted_three
    before = scene.objects["Key"].data.energy
    assert bpy.ops.relume.solve() == {"FINISHED"}
    report = json.loads(scene.relume_solve.report)
    lines = [line["text"] for line in report["lines"]]
    assert [line.partition(",")[0] for line in lines] == ["Goal 1", "'Left': Goal 2", "'Right': Goal 3"]
    assert all(line["met"] for line in report["lines"]), lines
    assert bpy.ops.relume.apply_solved() == {"FINISHED"}
    gain = np.log2(scene.objects["Key"].data.energy / before)
    assert abs(gain - STOPS) < 0.15 and strokes_of(scene) == ()


def test_a_goal_in_another_shot_alone_is_enough(painted_three):
    scene, (_, left, _right) = painted_three
    scene.relume_solve.strokes = core.to_json(stroke for stroke in strokes_of(scene) if stroke.shot == left)
    assert bpy.ops.relume.solve() == {"FINISHED"}
    (line,) = json.loads(scene.relume_solve.report)["lines"]
    assert line["text"].startswith("'Left': Goal 1") and line["met"]


def test_strokes_are_those_of_the_shot_that_a_view_shows(painted_three):
    scene, keys = painted_three
    assert [stroke_shots.key_of(scene, scene.objects[name]) for name in ("Camera", "Left", "Right")] == keys
    everything = strokes_of(scene)
    for key in keys:
        assert [stroke.shot for stroke in stroke_shots.strokes_in(scene, everything, key)] == [key]
    bpy.ops.relume.scribble(points="[[0.5, 0.5, 1.0]]", goal="darker", radius=0.1)
    painted = stroke_shots.strokes_in(scene, strokes_of(scene), keys[0])
    assert [stroke.meaning.goal for stroke in painted] == ["brighter", "darker"], (
        "without a shot it is the current one's"
    )


def test_a_shot_that_cannot_be_looked_at_is_named(painted_three):
    scene, _ = painted_three
    (shot_list.all_shots(scene)[1].folder / "manifest.json").unlink()
    with pytest.raises(SolveError, match="Shot 'Left' has no bake yet: press Bake All"):
        operators.begin(scene)
    scene.relume_shots.items[1].use_frame, scene.relume_shots.items[1].frame = True, 20
    with pytest.raises(SolveError, match="Shot 'Left' is of frame 20"):
        operators.begin(scene)
