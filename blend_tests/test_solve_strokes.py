"""Strokes are kept, drawn and asked for as they were painted."""

import json
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix

import addon
from addon.core import coverage
from addon.core.strokes import (
    BRIGHTER,
    COLOR,
    ERASE,
    KEEP,
    Stroke,
    StrokeError,
    from_json,
    goals,
    meaning,
    thinned,
    to_json,
)
from addon.engine.solve import request
from addon.engine.solve.request import strokes_of
from addon.viewport import strokes as drawing
from addon.viewport.camera_frame import Rectangle

LINE = ((0.2, 0.5, 1.0), (0.8, 0.5, 1.0))
SIZE = (160, 90)


@pytest.fixture(autouse=True)
def registered(scene):
    """The add-on, enabled."""
    addon.register()
    yield
    addon.unregister()


def stroke(goal=BRIGHTER, amount=1.0, points=LINE, radius=0.1, strength=1.0, color=(1, 1, 1)):
    """A stroke across the middle."""
    return Stroke(meaning(goal, amount, color), radius, strength, points)


def test_strokes_are_parsed_once(monkeypatch):
    parsed = []
    monkeypatch.setattr(request.core_strokes, "from_json", lambda text: parsed.append(text) or ())
    request._strokes_in.cache_clear()
    painted = SimpleNamespace(relume_solve=SimpleNamespace(strokes="[]"))
    for _ in range(3):
        strokes_of(painted)
    assert len(parsed) == 1
    request._strokes_in.cache_clear()


def test_text_brings_strokes_back():
    strokes = (stroke(), stroke(COLOR, color=(1.0, 0.5, 0.25)), stroke(ERASE, points=((0.5, 0.5, 0.3),)))
    assert from_json(to_json(strokes)) == strokes and from_json("") == ()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"goal": "louder"}, '"goal".*louder'),
        ({"radius": float("nan")}, '"radius"'),
        ({"radius": 0.0}, '"radius"'),
        ({"strength": True}, '"strength"'),
        ({"points": []}, '"points"'),
        ({"points": [[0.5, float("inf"), 1.0]]}, '"points"'),
        ({"points": [[0.5, 0.5]]}, '"points"'),
        ({"color": [1.0, -1.0, 0.0]}, '"color"'),
        ({"amount": None}, '"amount"'),
    ],
)
def test_damaged_strokes_are_refused_by_name(change, says):
    data = json.loads(to_json([stroke()]))
    data["strokes"][0] |= change
    with pytest.raises(StrokeError, match=f"stroke 1 .*{says}"):
        from_json(json.dumps(data))


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"format": "relume-strokes", "version": 2}', '{"format": "relume-strokes"}']
)
def test_what_are_no_strokes_is_refused(text):
    with pytest.raises(StrokeError):
        from_json(text)


def test_a_stroke_covers_its_capsule_at_any_aspect():
    (cover,) = coverage.layers([stroke()], SIZE).values()
    y, x = np.mgrid[0:90, 0:160] + 0.5
    distance = np.hypot(x - np.clip(x, 0.2 * 160, 0.8 * 160), y - 45)
    assert (cover[distance < 0.85 * 9 - 0.5] == 1.0).all() and (cover[distance > 1.15 * 9 + 0.5] == 0.0).all()
    assert 0.0 < cover[distance < 9].min() < 1.0, "the rim is soft"


def test_strokes_beyond_the_frame_cover_what_is_inside():
    wild = stroke(points=((-3.0, -3.0, 1.0), (4.0, 4.0, 1.0)))
    (cover,) = coverage.layers([wild], SIZE).values()
    assert cover[45, 80] == 1.0 and cover[0, 159] == 0.0
    (cover,) = coverage.layers([stroke(points=((9.0, 9.0, 1.0),))], SIZE).values()
    assert not cover.any()


def test_pressure_and_strength_scale_radius_and_weight():
    (cover,) = coverage.layers([stroke(points=((0.5, 0.5, 0.5),), strength=0.25)], SIZE).values()
    assert cover.max() == 0.25 and cover[45, 80 + 6] == 0.0 and cover[45, 80 + 3] > 0.0


def test_an_eraser_takes_from_what_is_there_and_not_from_what_comes():
    strokes = [stroke(), stroke(ERASE, points=((0.5, 0.5, 1.0),)), stroke(KEEP, points=((0.5, 0.5, 1.0),))]
    brighter, keep = coverage.layers(strokes, SIZE).values()
    assert brighter[45, 80] == 0.0 and brighter[45, 40] == 1.0 and keep[45, 80] == 1.0
    brighter, keep = goals(strokes)
    assert [part["erase"] for part in brighter["where"]["strokes"]] == [False, True, True]
    assert [part["erase"] for part in keep["where"]["strokes"]] == [False]


def test_each_meaning_is_one_goal_with_its_unit():
    strokes = [stroke(), stroke(amount=2.0), stroke(), stroke("warmer", 60.0), stroke(COLOR, color=(1, 0, 0))]
    found = [{key: value for key, value in goal.items() if key != "where"} for goal in goals(strokes)]
    assert found == [
        {"goal": "brighter", "stops": 1.0},
        {"goal": "brighter", "stops": 2.0},
        {"goal": "warmer", "mireds": 60.0},
        {"goal": "color", "color": [1, 0, 0]},
    ]
    assert [part["erase"] for part in goals(strokes)[0]["where"]["strokes"]] == [False, True, False]


@pytest.mark.parametrize(
    ("over", "under", "remains"),
    [
        (BRIGHTER, "darker", 0.0),
        ("shadow", BRIGHTER, 0.0),
        (KEEP, "warmer", 0.0),
        ("cooler", COLOR, 0.0),
        ("warmer", BRIGHTER, 1.0),
        (BRIGHTER, BRIGHTER, 1.0),
    ],
)
def test_what_is_painted_over_its_opposite_replaces_it(over, under, remains):
    first, second = stroke(under), stroke(over, points=((0.5, 0.5, 1.0),))
    found = coverage.layers([first, second], SIZE)
    assert found[first.meaning][45, 80] == remains and found[first.meaning][45, 40] == 1.0
    erased = [part["erase"] for part in goals([first, second])[0]["where"]["strokes"]]
    assert (True in erased) == (remains == 0.0)


def test_points_that_the_brush_hides_are_dropped():
    points = [(x / 1000, 0.5, 1.0) for x in range(1001)]
    thin = thinned(points, 0.1, 16 / 9)
    assert len(thin) < 100 and thin[0] == points[0] and thin[-1] == points[-1]
    dense, sparse = (coverage.layers([stroke(points=tuple(found))], SIZE).popitem()[1] for found in (points, thin))
    assert np.abs(dense - sparse).max() < 0.05


def test_drawing_is_premultiplied_and_later_meanings_cover_earlier_ones():
    pixels = coverage.painted([stroke(), stroke(KEEP, points=((0.5, 0.5, 1.0),))], SIZE)
    assert (pixels[..., :3] <= pixels[..., 3:] + 1e-6).all() and pixels[0].max() == 0.0
    green, yellow = pixels[45, 80], pixels[45, 40]
    assert green[1] > green[0] and yellow[0] > yellow[2]


def paint(points=LINE, **settings):
    """Paints by the operator, as a script does."""
    return bpy.ops.relume.scribble(points=json.dumps(points), **settings)


def test_each_stroke_is_a_step_of_undo_and_is_saved(scene, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    assert paint(goal="brighter", amount=1.5, radius=0.1) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="stroke")  # As the window does after an operator.
    assert paint(goal="erase", radius=0.05) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="eraser")
    assert [found.meaning.goal for found in strokes_of(bpy.context.scene)] == ["brighter", "erase"]
    bpy.ops.ed.undo()
    assert [found.meaning.goal for found in strokes_of(bpy.context.scene)] == ["brighter"]
    bpy.ops.ed.undo()
    assert strokes_of(bpy.context.scene) == ()
    bpy.ops.ed.redo()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    (kept,) = strokes_of(bpy.context.scene)
    assert kept.meaning == meaning("brighter", 1.5) and kept.points == LINE
    assert bpy.ops.relume.clear_strokes() == {"FINISHED"} and strokes_of(bpy.context.scene) == ()


@pytest.mark.parametrize("points", ["", "[]", "[[0.5]]", "[[1, 2, 7]]", '[["a", 1, 1]]', "7", "[[NaN, 0, 1]]"])
def test_hostile_points_are_refused_and_nothing_is_kept(scene, points):
    with pytest.raises(RuntimeError, match="cannot be kept"):
        bpy.ops.relume.scribble(points=points)
    assert scene.relume_solve.strokes == ""


def test_strokes_of_a_newer_version_are_left_alone(scene):
    text = scene.relume_solve.strokes = '{"format": "relume-strokes", "version": 9, "strokes": []}'
    assert strokes_of(scene) == ()
    with pytest.raises(RuntimeError, match="update Relume"):
        paint()
    assert scene.relume_solve.strokes == text


def test_strokes_and_rectangles_are_drawn_where_they_are(scene, gpu_started):
    import gpu

    width, height = SIZE
    target = gpu.types.GPUOffScreen(width, height, format="RGBA32F")
    frame = Rectangle(20.0, 10.0, 140.0, 80.0)
    with target.bind():
        buffer = gpu.state.active_framebuffer_get()
        buffer.clear(color=(0.0, 0.0, 0.0, 0.0))
        gpu.matrix.load_matrix(Matrix.Translation((-1, -1, 0)) @ Matrix.Diagonal((2 / width, 2 / height, 1, 1)))
        gpu.matrix.load_projection_matrix(Matrix.Identity(4))
        rectangle = (meaning(KEEP), (0.1, 0.1, 0.3, 0.3))
        drawing.draw(frame, (stroke(points=((0.75, 0.75, 1.0),)),), [rectangle])
        pixels = np.array(buffer.read_color(0, 0, width, height, 4, 0, "FLOAT").to_list())
    target.free()
    drawing.free()
    x, y = 20 + 0.75 * 120, 80 - 0.75 * 70
    assert pixels[round(y), round(x), 3] > 0.5 and pixels[round(y), round(x), 0] > pixels[round(y), round(x), 2]
    green = np.argwhere((pixels[..., 1] > 0.5) & (pixels[..., 0] < 0.4))
    low, high = green.min(axis=0), green.max(axis=0)
    assert np.allclose(low, (80 - 0.3 * 70, 20 + 0.1 * 120), atol=1.5), "lower left corner"
    assert np.allclose(high, (80 - 0.1 * 70, 20 + 0.3 * 120), atol=1.5), "upper right corner"
    assert not pixels[round(y), 30].any(), "and nowhere else"
