"""The table of the view colours as Blender's own `save_render` does, and is baked no more often than needed."""

import bpy
import numpy as np
import pytest

from addon.export import view_transform
from addon.export.view_transform import displayed
from addon.viewport import view_table
from helpers import add_light, update
from views import VIEWS


@pytest.fixture(autouse=True)
def forgotten():
    view_table.clear()
    yield
    view_table.clear()


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


def test_colours_are_the_same_where_no_view_is_without_files(scene, small_tables, monkeypatch):
    scene.view_settings.view_transform = "AgX"
    expected = view_table.complete(scene).apply(some_colors())
    view_table.clear()
    monkeypatch.setattr(view_transform, "WITHOUT_FILES", "of another configuration")
    assert np.array_equal(view_table.complete(scene).apply(some_colors()), expected)
    assert scene.render.image_settings.color_management == "FOLLOW_SCENE"


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


def test_a_coarse_table_serves_until_the_fine_one_is_there(scene):
    scene.view_settings.view_transform = "AgX"
    assert view_table.of(scene) is None
    while not view_table.work(scene):
        assert view_table.of(scene) is None
    assert len(view_table.of(scene).table) == view_table.COARSE
    colors = some_colors()
    error = np.abs(view_table.of(scene).apply(colors) - displayed(scene, colors)) * 255
    assert error.mean() <= 1.0
    slices = 0
    while not view_table.is_complete(scene):
        view_table.work(scene)
        slices += 1
    assert slices > 1 and len(view_table.of(scene).table) == view_table.FINE
    scene.view_settings.gamma = 1.1
    assert len(view_table.of(scene).table) == view_table.FINE, "the last table serves until there is a better one"


def test_undo_in_the_middle_of_a_bake_begins_again(scene, small_tables):
    scene.view_settings.view_transform = "AgX"
    bpy.ops.ed.undo_push(message="one")
    scene.frame_current = 2
    bpy.ops.ed.undo_push(message="two")
    while view_table.of(scene) is None:
        view_table.work(scene)
    view_table.work(scene)  # A slice of the fine table.
    bpy.ops.ed.undo()
    assert view_table.complete(bpy.context.scene).table is not None


def test_a_table_in_the_making_leaves_nothing_to_be_saved(scene, small_tables):
    """Or Blender asks the artist who presses Ctrl S about an image that nobody has seen."""
    scene.view_settings.view_transform = "AgX"
    turns = 0
    while not view_table.is_complete(scene):
        view_table.work(scene)
        assert not any(image.is_dirty for image in bpy.data.images)
        turns += 1
    assert turns > 10


def test_a_table_in_the_making_leaves_the_objects_of_the_scene_alone(scene, small_tables):
    """When an image is removed Blender evaluates all objects again: once for a table, not once for a slice."""
    add_light(scene, "POINT")
    scene.view_settings.view_transform = "AgX"
    update()
    seen = []

    def note(_scene, depsgraph):
        seen.append(any(isinstance(found.id, bpy.types.Object) for found in depsgraph.updates))

    bpy.app.handlers.depsgraph_update_post.append(note)
    try:
        turns = 0
        while not view_table.is_complete(scene):
            view_table.work(scene)
            update()
            turns += 1
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(note)
    assert turns > 10 and sum(seen) <= 2, "a coarse table and a fine one"
    assert not bpy.data.images
