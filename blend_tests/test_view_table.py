"""The table of the view colours as Blender's own `save_render` does, and is baked no more often than needed."""

import bpy
import numpy as np
import pytest

from addon.export.view_transform import displayed
from addon.viewport import view_table
from views import VIEWS


@pytest.fixture(autouse=True)
def here(views_here):
    """Tables are made in this Blender."""


def some_colors(brightest=5.0):
    """Colours of all hues from 2^-8 to 2^brightest, and black."""
    colors = np.exp2(np.random.default_rng(1).uniform(-8.0, brightest, (100, 200, 3))).astype(np.float32)
    colors[0, :4] = 0.0
    return colors


@pytest.mark.parametrize("name", VIEWS)
def test_the_table_colours_as_blender_does(scene, name):
    VIEWS[name](scene)
    colors = some_colors()
    error = np.abs(view_table.complete(scene).apply(colors) - displayed(scene, colors)) * 255
    print(f"{name}: mean {error.mean():.3f}, p99 {np.percentile(error, 99):.2f}, max {error.max():.1f} of 255")
    assert error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0


@pytest.mark.skipif(bpy.app.version < (5, 0, 0), reason="files choose their working space from Blender 5.0 on")
@pytest.mark.parametrize("name", ["AgX", "Standard", "Standard, exposure and gamma"])
def test_a_view_in_another_working_space_colours_as_blender_does(scene, name):
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    VIEWS[name](scene)
    colors = some_colors()
    error = np.abs(view_table.complete(scene).apply(colors) - displayed(scene, colors)) * 255
    assert error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0, (error.mean(), np.percentile(error, 99))


@pytest.mark.parametrize("name", ["AgX", "Filmic", "Khronos"])
def test_lamps_and_highlights_keep_their_colour(scene, name):
    VIEWS[name](scene)
    colors = some_colors(brightest=13.0)
    error = np.abs(view_table.complete(scene).apply(colors) - displayed(scene, colors)) * 255
    print(f"{name}: mean {error.mean():.3f}, p99 {np.percentile(error, 99):.2f}, max {error.max():.1f} of 255")
    assert error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0


def test_the_scene_is_as_it_was(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    output = scene.render.image_settings
    output.file_format, output.color_depth, scene.render.dither_intensity = "OPEN_EXR", "16", 0.4
    before = {name: set(getattr(bpy.data, name).keys()) for name in ("images", "scenes", "textures")}
    view_table.complete(scene)
    assert (output.file_format, output.color_depth) == ("OPEN_EXR", "16")
    assert scene.render.dither_intensity == pytest.approx(0.4)
    assert before == {name: set(getattr(bpy.data, name).keys()) for name in before}


def test_dragging_exposure_bakes_nothing(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    table = view_table.complete(scene).table
    scene.view_settings.exposure = 1.0
    assert view_table.is_complete(scene)
    assert view_table.of(scene).table is table and view_table.of(scene).scale == 2.0


@pytest.mark.parametrize("name", ["AgX", "False Color"])
def test_exposure_changed_in_the_middle_of_a_bake_does_no_harm(scene, name):
    scene.view_settings.view_transform = name
    while not view_table.is_complete(scene):
        view_table.work(scene)
        scene.view_settings.exposure += 0.05
    colors = some_colors()
    error = np.abs(view_table.of(scene).apply(colors) - displayed(scene, colors)) * 255
    assert np.percentile(error, 99) <= 3.0


def test_what_shapes_the_view_bakes_a_new_table(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    seen = [view_table.complete(scene).table]
    for name in ("AgX, look", "AgX, exposure and gamma", "AgX, curves", "Filmic"):
        VIEWS[name](scene)
        assert not view_table.is_complete(scene), name
        table = view_table.complete(scene).table
        assert all(table is not before for before in seen), name
        seen.append(table)
    scene.view_settings.curve_mapping.curves[2].points[0].location[1] = 0.1
    assert not view_table.is_complete(scene)


def test_the_last_table_serves_until_the_next_is_there(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    assert view_table.of(scene) is None
    while not view_table.work(scene):
        assert view_table.of(scene) is None
    before = view_table.of(scene).table
    scene.view_settings.gamma = 1.1
    while not view_table.work(scene):
        assert view_table.of(scene).table is before
    assert view_table.is_complete(scene) and view_table.of(scene).table is not before


def test_undo_in_the_middle_of_a_bake_goes_on(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    bpy.ops.ed.undo_push(message="one")
    scene.frame_current = 2
    bpy.ops.ed.undo_push(message="two")
    view_table.work(scene)
    bpy.ops.ed.undo()
    while not view_table.is_complete(bpy.context.scene):
        view_table.work(bpy.context.scene)
    assert view_table.of(bpy.context.scene) is not None


def test_where_no_other_blender_starts_this_one_makes_the_table(scene, views_here, monkeypatch):
    scene.view_settings.view_transform = "AgX"

    def refuse(_job):
        raise OSError("no such program")

    monkeypatch.setattr(views_here, "ask", refuse)
    assert view_table.work(scene) and view_table.is_complete(scene)
