"""A small light that is moved away from where the paths look, in a tiny shot with the real solver."""

import json

import bpy
import pytest

from addon.core.status import out_of_sight
from addon.engine import shot, solve
from addon.ui import solving
from addon.ui.start import start
from helpers import settled, until


@pytest.fixture
def shown(studio):
    """With its picture, and a stroke for a light that may only move."""
    bpy.data.lights["Key"].shadow_soft_size = 0.01
    studio.relume_solve.effort = "QUICK"
    start(studio)
    until(studio, settled, "the first pictures")
    for move in ("position", "color", "strength"):  # Free is the place alone.
        bpy.ops.relume.lock_all(move=move)
    bpy.ops.relume.scribble(points="[[0.9, 0.5, 1.0]]", goal="brighter", amount=2.0, radius=0.2)
    return studio


@pytest.fixture
def asked(monkeypatch):
    """Requests and folders that the solver was given."""
    given, real = [], solve.start

    def kept(found, request, images, folder=None):
        given.append((request, folder))
        return real(found, request, images, folder)

    monkeypatch.setattr(solve, "start", kept)
    return given


def notes(scene):
    """What the result says besides its goals."""
    return json.loads(scene.relume_solve.report)["notes"]


def test_it_is_solved_on_with_paths_that_look_for_it(shown, asked):
    assert bpy.ops.relume.solve() == {"FINISHED"}
    (first, own), (second, folder) = asked
    assert own is None and "from" not in first and first["steps"] > 0
    assert (second["steps"], second["from"]["changed"]) == (0, ["Key"])
    assert folder.parent == shot.of(shown).folder and not folder.exists()
    assert any("Rebake looks there" in note for note in notes(shown))
    assert bpy.ops.relume.apply_solved() == {"FINISHED"}
    until(shown, settled, "the picture")
    assert any("'Key': its direct light is found by one path in" in note for note in shot.of(shown).notes)
    assert out_of_sight(shot.of(shown).status) == ["Few paths meet 'Key' where it is now"]
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    until(shown, settled, "the new picture")
    assert not shot.of(shown).notes and not out_of_sight(shot.of(shown).status)


def test_an_edited_scene_is_left_to_the_paths_that_are_there(shown, asked):
    bpy.data.objects["Plane"].location.z = -0.2
    bpy.context.view_layer.update()
    assert bpy.ops.relume.solve() == {"FINISHED"}
    assert len(asked) == 1 and any("uncertain" in note for note in notes(shown))


def test_what_keeps_new_paths_from_being_traced_loses_no_answer(shown, asked):
    (shot.of(shown).folder / "solve").write_text("in the way")
    assert bpy.ops.relume.solve() == {"FINISHED"}
    assert len(asked) == 1 and any("uncertain" in note for note in notes(shown))
    assert [look.name for look in shown.relume_looks.items] == ["Before", "Solve 1"]


def test_cancelling_leaves_nothing_behind(shown, asked):
    energy, place = bpy.data.lights["Key"].energy, tuple(bpy.data.objects["Key"].location)
    found = solving.begin(shown)
    until(shown, lambda _: found.step() and len(asked) == 2, "the second part")
    assert asked[1][1].exists()
    found.cancel()
    assert not asked[1][1].exists() and not shown.relume_looks.items
    assert (bpy.data.lights["Key"].energy, tuple(bpy.data.objects["Key"].location)) == (energy, place)
