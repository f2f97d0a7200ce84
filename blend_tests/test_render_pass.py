"""A view with the shading "Rendered" shows one pass of the picture, and nothing else takes that for the picture."""

import bpy
import numpy as np
import pytest

from addon.core.pass_names import only
from addon.engine.shot import shot
from addon.live.scheduler import scheduler
from addon.ui.start import start
from addon.viewport import views
from fake_live import FakeLive
from helpers import add_light, add_quad, add_world, row, settled, until, update

WHOLE = {"Key", "Rim.001", "static"}
"""Passes that shine in the picture itself."""


def view():
    """The shading of the 3D view."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return next(area.spaces.active.shading for area in areas if area.type == "VIEW_3D")


def show(scene, name):
    """Chooses a pass in the view, in the shading that shows it."""
    scene.render.engine, view().type = "RELUME", "RENDERED"
    view().relume.name_of_pass = name


def shining(request):
    """Lights of a request whose gain is not 0, and whether world and static light are in it."""
    lights = {name for name, gain in request["gains"].items() if any(gain)}
    return lights | {name for name in ("world", "static") if any(request[name])}


@pytest.fixture
def two(lit):
    """Two lights with a whole picture; the scene and the fake native module."""
    return with_picture(lit, "ready")


def with_picture(lit, state):
    """Two lights with a whole picture while the native module is in a state."""
    add_light(lit, "AREA", name="Rim.001")
    update()
    start(lit)
    live = FakeLive.made[-1]
    live.tell(samples=4, state=state)
    live.show()
    scheduler.tick()
    return lit, live


def answer(live, **picture):
    """The native module makes the picture of the newest request, and the add-on takes it."""
    live.show(serial=live.newest.serial + 1, **picture)
    scheduler.tick()
    return live.newest


def test_a_pass_is_asked_for_when_the_picture_is_there_and_the_picture_again_afterwards(two):
    scene, live = two
    found, whole, asked = shot.of(scene), live.newest, len(live.requests)
    show(scene, "Combined_Rim_001")
    scheduler.tick()
    assert shining(live.requests[-1]) == {"Rim.001"} and found.is_busy
    assert found.picture_of("Combined_Rim_001") is whole, "until it comes"
    rim = answer(live, samples=1)
    assert found.picture_of("Combined_Rim_001") is rim
    assert found.picture is whole and found.present_frame is whole, "the picture stays what it was"
    assert found.status.live.shown["samples"] == 4, "and so does what is said of it"
    assert shining(live.requests[-1]) == WHOLE
    again = answer(live)
    assert found.picture is again and found.picture_of("Combined_Rim_001") is rim
    for _ in range(3):
        scheduler.tick()
    assert len(live.requests) == asked + 2 and not found.is_busy, "there is nothing left to do"


def test_the_pass_follows_edits_and_rows(two):
    scene, live = two
    show(scene, "Combined_Key")
    scheduler.tick()
    answer(live)
    answer(live)
    row(scene, "Key").exposure = 1.0
    answer(live)
    assert shining(live.requests[-1]) == {"Key"} and live.requests[-1]["gains"]["Key"] == [2.0] * 3
    assert live.requests[-1]["interactive"], "while it is dragged"


def test_an_answer_that_was_overtaken_is_not_waited_for(two):
    scene, live = two
    found = shot.of(scene)
    show(scene, "Combined_Key")
    scheduler.tick()
    scheduler.settling.clear()
    bpy.data.lights["Key"].energy = 5.0
    update()
    assert shining(live.requests[-1]) == WHOLE
    whole = answer(live)
    assert found.picture is whole
    assert shining(live.requests[-1]) == {"Key"}, "it is asked for once more"
    key = answer(live)
    assert found.picture_of("Combined_Key") is key


def test_no_pass_is_asked_for_while_paths_are_traced(lit):
    """They look for the lights of the newest request."""
    scene, live = with_picture(lit, "baking")
    asked = len(live.requests)
    show(scene, "Combined_Key")
    answer(live)
    assert len(live.requests) == asked and shot.of(scene).is_tracing
    live.tell(state="training")
    scheduler.tick()
    scheduler.tick()
    assert shining(live.requests[-1]) == {"Key"}


def test_what_surfaces_are_is_asked_for_once_for_all_lights(two):
    scene, live = two
    show(scene, "Normal")
    scheduler.tick()
    assert live.requests[-1]["aov"] == "normal"
    normal = answer(live)
    answer(live)
    row(scene, "Key").exposure = 1.0
    answer(live)
    scheduler.settling.clear()
    scheduler.request_picture(scene)
    answer(live)
    assert shot.of(scene).picture_of("Normal") is normal
    assert [request.get("aov") for request in live.requests].count("normal") == 1
    live.tell(samples=8)
    scheduler.tick()
    assert live.requests[-1]["aov"] == "normal", "more paths know it better"


@pytest.mark.parametrize("how", ["renamed", "deleted"])
def test_without_its_light_the_view_shows_the_whole_picture(two, how):
    scene, live = two
    found = shot.of(scene)
    show(scene, "Combined_Key")
    assert view().relume.render_pass == "Combined_Key"
    scheduler.tick()
    answer(live)
    answer(live)
    if how == "renamed":
        scene.objects["Key"].name = "Sun"
    else:
        bpy.data.objects.remove(scene.objects["Key"])
    update()
    scheduler.request_picture(scene)
    answer(live)
    scheduler.tick()
    assert shining(live.requests[-1]) >= {"Rim.001", "static"}, "nothing is asked for that is not there"
    assert found.picture_of("Combined_Key") is found.picture
    assert view().relume.render_pass == "Combined"


def test_other_views_and_engines_want_nothing(two):
    scene, _live = two
    show(scene, "world")
    assert views.passes_of(scene, shot.of(scene)) == {"world"}
    view().type = "SOLID"
    assert views.passes_of(scene, shot.of(scene)) == set()
    view().type, scene.render.engine = "RENDERED", "CYCLES"
    assert views.passes_of(scene, shot.of(scene)) == set()
    show(scene, "Combined")
    assert views.passes_of(scene, shot.of(scene)) == set()


def test_the_menu_sets_what_it_shows(two):
    for name in ("Combined", "Combined_Key", "Combined_Rim_001", "world", "static", "Depth", "Normal", "Diffuse Color"):
        view().relume.render_pass = name
        assert view().relume.render_pass == view().relume.name_of_pass == name


def test_content_without_the_pass_has_none():
    content = {"lights": [{"name": "Key"}], "gains": {"Key": [2.0] * 3}, "world": [1.0] * 3, "static": [1.0] * 3}
    assert shining(only(content, "Combined_Key")) == {"Key"}
    assert shining(only(content, "static")) == {"static"}
    assert only(content, "Combined_Gone") is None and only(content, "Combined") is None


def test_surfaces_of_a_real_bake_are_those_of_final_renders(studio):
    import relume

    add_quad(studio, "Near", size=0.5).location.z = 1.0
    update()
    start(studio)
    whole = until(studio, settled, "the picture").frame.image.copy()
    final = relume.Relighter(shot.of(studio).folder).relight("[]")
    shown = {}
    for name in ("Normal", "Diffuse Color", "Depth"):
        show(studio, name)
        scheduler.tick()
        found = until(studio, settled, name)
        assert found.picture is not found.picture_of(name)
        assert np.abs(found.picture.image - whole).max() < 1e-5 * whole.max()
        shown[name] = found.picture_of(name).image[..., :3][::-1]
    assert np.array_equal(shown["Normal"], final["normal"])
    assert np.array_equal(shown["Diffuse Color"], final["albedo"])
    depth, distance = shown["Depth"][..., 0], final["depth"][..., 0]
    seen = distance > 0.0
    assert depth[distance == distance[seen].min()].max() == 0.0 and depth[distance == distance.max()].min() == 1.0
    assert (depth[~seen] == 1.0).all()
    assert np.corrcoef(depth[seen], distance[seen])[0, 1] > 0.9999


def test_passes_of_a_real_bake_add_up_and_leave_the_picture_alone(studio):
    add_light(studio, "AREA", name="Rim", location=(1, 0, 2))
    add_world(studio)
    update()
    start(studio)
    whole = until(studio, settled, "the picture").frame.image.copy()
    total = np.zeros_like(whole)
    for name in ("Combined_Key", "Combined_Rim", "world", "static"):
        show(studio, name)
        # Nothing is under way yet when the view changes: the timer is what asks.
        scheduler.tick()
        found = until(studio, settled, name)
        assert found.picture_of(name) is not found.picture
        assert np.abs(found.picture.image - whole).max() < 1e-5 * whole.max()
        total += found.picture_of(name).image
    assert total[..., :3].max() > 0.0
    assert np.abs(total - whole)[..., :3].max() < 1e-3 * whole.max()
