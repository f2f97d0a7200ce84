"""A small light that is moved away from where the paths look, in a tiny shot with the real solver."""

import json
import time
from types import SimpleNamespace

import bpy
import pytest

from addon.core.solve import SolveError, moved_out_of_sight, samples_towards
from addon.core.status import out_of_sight
from addon.engine.shot import shot
from addon.engine.solve import handle as solve
from addon.engine.solve import new_paths
from addon.ui.solve import operators
from addon.ui.start import start
from helpers import add_world, settled, shear, until


@pytest.fixture
def shown(studio):
    """With its picture, and a stroke for a light that may only move."""
    shear(studio, bpy.data.objects["Key"])
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

    def kept(found, request, images, folders):
        given.append((request, *folders))
        return real(found, request, images, folders)

    monkeypatch.setattr(solve, "start", kept)
    return given


def notes(scene):
    """Notes of the result."""
    return json.loads(scene.relume_solve.report)["notes"]


def test_it_is_solved_on_with_paths_that_look_for_it(shown, asked):
    assert bpy.ops.relume.solve() == {"FINISHED"}
    (first, own), (second, folder) = asked
    assert own == shot.of(shown).folder and "from" not in first and first["steps"] > 0
    assert (second["steps"], second["from"]["changed"]) == (0, ["Key"])
    assert folder.parent == shot.of(shown).folder and not folder.exists()
    assert any("Rebake traces paths that look there" in note for note in notes(shown))
    assert bpy.ops.relume.apply_solved() == {"FINISHED"}
    until(shown, settled, "the picture")
    assert any("'Key': its direct light is found by one path in" in note for note in shot.of(shown).notes)
    assert out_of_sight(shot.of(shown).status) == ["Few paths meet 'Key' where it is now"]
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    until(shown, settled, "the new picture")
    assert not any("is found by one path in" in note for note in shot.of(shown).notes)
    assert not out_of_sight(shot.of(shown).status)


def test_no_paths_are_traced_for_lights_that_stay_where_they_are(shown, asked):
    """Nor where one was moved after the bake, as that picture is the same noise before and after."""
    bpy.data.objects["Key"].location.x = 1.0
    for move in ("position", "strength"):  # Free is the strength alone.
        bpy.ops.relume.lock_all(move=move)
    until(shown, settled, "the picture of the light in its new place")
    assert out_of_sight(shot.of(shown).status) == ["Few paths meet 'Key' where it is now"]
    assert bpy.ops.relume.solve() == {"FINISHED"}
    assert len(asked) == 1 and asked[0][0]["free"] == {"Key": ["strength"]}
    assert notes(shown) == ["Few paths meet 'Key', so the result is uncertain: Rebake, then solve again"]


def area(by=0.0, turn=0.0, **kind):
    """An area light of a request."""
    matrix = (1.0, turn, 0.0, 0.5 + by), (-turn, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 2.0), (0.0, 0.0, 0.0, 1.0)
    kind = {"type": "AREA", "shape": "RECTANGLE", "size": 0.5, "size_y": 0.2, "spread": 3.0} | kind
    return {"name": "Strip", "world_from_object": matrix, "kind": kind}


ASKED_AND_FOUND = [
    (area(), area(), False),
    (area(), area(by=1e-6), False),
    (area(), area(by=1e-2), True),
    (area(), area(turn=0.1), True),
    (area(), area(size=0.4), True),
    (area(), area(size_y=0.4), True),
    (area(), area(spread=2.0), True),
    (area(), area(shape="ELLIPSE"), True),
    (area() | {"name": "Other"}, area(), True),
    ({"name": "Strip", "shape": {"type": "sphere"}}, area(), True),
]


@pytest.mark.parametrize("asked_for, found, is_looked_for", ASKED_AND_FOUND)
def test_lights_that_were_moved_turned_reshaped_or_added_are_looked_for(asked_for, found, is_looked_for):
    blender = [found["kind"] | {"name": "Strip", "world_from_object": found["world_from_object"], "energy": 9.0}]
    answer = {"rarely_met": ["Strip"], "blender": blender}
    assert moved_out_of_sight(answer, [asked_for]) == ["Strip"] * is_looked_for
    assert moved_out_of_sight(answer | {"rarely_met": []}, [asked_for]) == []
    assert moved_out_of_sight(answer | {"blender": []}, [asked_for]) == ["Strip"], "Blender cannot have it"


def test_new_paths_are_a_share_of_the_bakes_but_enough():
    """A quarter, 64 at least, and never more than there were."""
    assert [samples_towards(baked) for baked in (4, 64, 128, 256, 1024)] == [4, 64, 64, 64, 256]


def test_new_paths_are_of_the_world_that_the_bake_began_with(shown):
    background = add_world(shown, color=(0.1, 0.2, 0.3), strength=1.0)
    start(shown)
    until(shown, settled, "the pictures under a world")
    background.inputs["Strength"].default_value = 4.0
    bpy.context.view_layer.update()
    found = shot.of(shown)
    with new_paths.folder_in(found) as folder:
        for _job in new_paths.bake(shown, found, [], folder):
            time.sleep(0.01)
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["world_color"] == pytest.approx([0.1, 0.2, 0.3])


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
    found = operators.begin(shown)
    until(shown, lambda _: found.step() and len(asked) == 2, "the second part")
    assert asked[1][1].exists()
    found.cancel()
    while new_paths.clean_up() is not None:
        time.sleep(0.01)
    assert not asked[1][1].exists() and not shown.relume_looks.items
    assert (bpy.data.lights["Key"].energy, tuple(bpy.data.objects["Key"].location)) == (energy, place)


def test_cancelling_does_not_wait_for_a_job_that_prepares(studio, tmp_path):
    calls = []
    job = SimpleNamespace(done=False, cancel=lambda: calls.append("cancel"), result=lambda: calls.append("result"))
    live = SimpleNamespace(samples=4, world_color=[0.5, 0.5, 0.5], world_map="sky")
    found = SimpleNamespace(folder=tmp_path, status=SimpleNamespace(live=live), options=SimpleNamespace(threads=1))
    (tmp_path / "manifest.json").write_text('{"scene_hash": "same"}')
    with pytest.MonkeyPatch.context() as patched:
        exported = SimpleNamespace(hash="same", world_map="sky")
        patched.setattr(new_paths, "load_scene_async", lambda _s, _o, done: done(exported, None))
        patched.setattr(new_paths, "native", lambda: SimpleNamespace(bake=lambda *_arguments: job))
        with new_paths.folder_in(found) as folder:
            folder.mkdir()
            (folder / "lights.json").write_text("{}")
            work = new_paths.bake(studio, found, [], folder)
            assert next(work) is job
            work.close()
    assert calls == ["cancel"] and (folder / "lights.json").exists(), "it may still write there"
    with pytest.raises(SolveError, match="still ending"), new_paths.folder_in(found):
        pass
    job.done = True
    assert new_paths.clean_up() is None and not folder.exists()
