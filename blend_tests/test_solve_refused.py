"""Requests that cannot be solved get one clear line, and change nothing."""

import json

import bpy
import pytest
import relume
from solve_steps import LINE, read, state_of, target_image

from addon.core.solve import SolveError
from addon.engine.shot import shot
from addon.engine.solve import solving
from addon.engine.solve.target_image import awaited, picture_size, reading_of
from addon.live.scheduler import scheduler
from addon.viewport import compare as pairs
from fake_live import FakeLive
from fake_solve import FakeJob


def no_bake(scene):
    shot.close_all()
    return "Press Start first"


def no_picture(scene):
    FakeLive.made[-1].tell(samples=0)
    scheduler.tick()
    return "Wait for the first picture"


def no_goal(scene):
    bpy.ops.relume.clear_strokes()
    return "Say what the picture should do"


def all_erased(scene):
    bpy.ops.relume.scribble(points=LINE, goal="erase", radius=0.2)
    return "Say what the picture should do"


def nothing_free(scene):
    bpy.ops.relume.lock_all(move="strength")
    return "Nothing may change: unlock"


def black_target(scene):
    scene.relume_solve.target = target_image(value=0.0)
    return "'Painting' is all black"


def square_target(scene):
    scene.relume_solve.target = target_image((64, 64))
    return "'Painting' is 64 x 64 and the camera's frame 64 x 48"


def empty_mask(scene):
    bpy.ops.relume.add_region(kind="MASK")
    return "A region has no mask"


def no_object(scene):
    bpy.ops.relume.add_region(kind="OBJECT")
    return "A region has no object"


def unseen(scene):
    bpy.ops.relume.add_region(kind="OBJECT_INDEX")
    scene.relume_solve.regions[0].index = 99
    return "Not seen in the picture: object index 99"


def target_without_mask(scene):
    scene.relume_solve.target, scene.relume_solve.target_place.kind = target_image(), "MASK"
    return "The target's place has no mask: choose an image or let it count in the whole picture"


def target_without_size(scene):
    place, scene.relume_solve.target = scene.relume_solve.target_place, target_image()
    place.kind, place.rectangle = "RECTANGLE", (0.5, 0.5, 0.5, 0.9)
    return "The target's place has a rectangle without size"


def solver_refuses(scene):
    FakeJob.made.append(None)

    def refuse(*_arguments, **_options):
        raise ValueError("goal 1 has no place\nin the picture")

    relume.solve = refuse  # The fixture puts it back.
    return "goal 1 has no place in the picture"


@pytest.mark.parametrize(
    "spoil",
    [
        *(no_bake, no_picture, no_goal, all_erased, nothing_free, black_target, square_target, empty_mask, no_object),
        *(unseen, target_without_mask, target_without_size, solver_refuses),
    ],
)
def test_what_cannot_be_solved_is_one_clear_line(painted, spoil):
    says = spoil(painted)
    before = state_of(painted)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.relume.solve()
    assert state_of(painted) == before and solving.running(painted) is None
    assert len(painted.relume_looks.items) == 0
    assert not [job for job in FakeJob.made if job is not None and not job.is_cancelled]


def test_a_target_that_does_not_fit_is_said(baked, tmp_path):
    image = target_image((64, 64))
    image.filepath_raw, image.file_format = str(tmp_path / "square.png"), "PNG"
    image.save()
    for name, says in (("square.png", "crop it to the same aspect"), ("broken.png", "broken.png")):
        (tmp_path / "broken.png").write_bytes(b"no picture")
        assert bpy.ops.relume.load_target(filepath=str(tmp_path / name)) == {"FINISHED"}
        with pytest.raises(SolveError, match=says):
            read(awaited(baked))
        assert says in reading_of(baked).error, "the panel says it"
    bpy.ops.relume.clear_target()
    assert reading_of(baked) is None
    with pytest.raises(RuntimeError, match="cannot be opened"):
        bpy.ops.relume.load_target(filepath=str(tmp_path / "none.png"))
    assert baked.relume_solve.target is None
    with pytest.raises(RuntimeError, match="clipboard holds no picture"):
        bpy.ops.relume.paste_target()


def test_a_target_from_a_file_is_shown_beside_the_picture(baked, tmp_path):
    image = target_image((128, 96))
    image.filepath_raw, image.file_format = str(tmp_path / "painting.png"), "PNG"
    image.save()
    assert bpy.ops.relume.load_target(filepath=str(tmp_path / "painting.png")) == {"FINISHED"}
    assert bpy.ops.relume.show_target() == {"FINISHED"}
    pair = pairs.pair_of(baked)
    assert pair.a.image.shape == (48, 64, 4) and pair.b is None and pair.labels == ("Target", "Relit")
    assert bpy.ops.relume.clear_target() == {"FINISHED"} and baked.relume_solve.target is None


def test_the_size_of_targets_is_that_of_the_bake(baked):
    folder = shot.of(baked).folder
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps({"width": 640, "height": 480}))
    assert picture_size(baked) == (640, 480)
    (folder / "manifest.json").write_text("{")
    baked.render.resolution_percentage = 50
    assert picture_size(baked) == (32, 24)
