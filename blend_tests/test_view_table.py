"""The table of the view colours as Blender's own `save_render` does, and is baked no more often than needed."""

import bpy
import numpy as np
import pytest

from addon.export.view_transform import displayed
from addon.viewport import view_table


def high_contrast(scene):
    look = "AgX - High Contrast" if bpy.app.version >= (4, 2, 0) else "High Contrast"
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", look


def curves(scene):
    view = scene.view_settings
    view.view_transform, view.use_curve_mapping, view.exposure = "AgX", True, 0.7
    view.curve_mapping.curves[3].points.new(0.4, 0.6)
    view.curve_mapping.curves[0].points.new(0.5, 0.45)
    view.curve_mapping.update()


def white_balance(scene):
    view = scene.view_settings
    if not hasattr(view, "use_white_balance"):
        pytest.skip("this Blender has no white balance in its view")
    view.view_transform, view.use_white_balance = "AgX", True
    view.white_balance_temperature, view.white_balance_tint = 4200.0, 25.0


def view(**settings):
    """Sets plain properties of the view."""

    def apply(scene):
        for key, value in settings.items():
            setattr(scene.view_settings, key, value)

    return apply


VIEWS = {
    "AgX": view(view_transform="AgX"),
    "AgX, exposure and gamma": view(view_transform="AgX", exposure=-1.3, gamma=1.4),
    "AgX, look": high_contrast,
    "AgX, curves": curves,
    "AgX, white balance": white_balance,
    "Filmic": view(view_transform="Filmic", exposure=2.0),
    "Filmic, look": view(view_transform="Filmic", look="Very High Contrast"),
    "Standard": view(view_transform="Standard"),
    "Standard, exposure and gamma": view(view_transform="Standard", exposure=0.8, gamma=0.7),
    "Khronos": view(view_transform="Khronos PBR Neutral"),
}


@pytest.fixture(autouse=True)
def forgotten():
    view_table.clear()
    yield
    view_table.clear()


def some_colors(count=20_000):
    """Colours of all hues from 2^-8 to 2^5, and black."""
    random = np.random.default_rng(1)
    colors = np.exp2(random.uniform(-8, 5, (count // 200, 200, 3))).astype(np.float32)
    colors[0, :4] = 0.0
    return colors


@pytest.mark.parametrize("name", VIEWS)
def test_the_table_colours_as_blender_does(scene, name):
    VIEWS[name](scene)
    colors = some_colors()
    error = np.abs(view_table.complete(scene).apply(colors) - displayed(scene, colors)) * 255
    print(f"{name}: mean {error.mean():.3f}, p99 {np.percentile(error, 99):.2f}, max {error.max():.1f} of 255")
    assert error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0


def test_the_scene_is_as_it_was(scene):
    scene.view_settings.view_transform = "AgX"
    output = scene.render.image_settings
    output.file_format, output.color_depth, scene.render.dither_intensity = "OPEN_EXR", "16", 0.4
    before = {name: set(getattr(bpy.data, name).keys()) for name in ("images", "scenes", "textures")}
    view_table.complete(scene)
    assert (output.file_format, output.color_depth) == ("OPEN_EXR", "16")
    assert scene.render.dither_intensity == pytest.approx(0.4)
    assert before == {name: set(getattr(bpy.data, name).keys()) for name in before}


def test_dragging_exposure_bakes_nothing(scene):
    scene.view_settings.view_transform = "AgX"
    table = view_table.complete(scene).table
    scene.view_settings.exposure = 1.0
    assert view_table.is_complete(scene)
    assert view_table.of(scene).table is table and view_table.of(scene).scale == 2.0


def test_exposure_changed_in_the_middle_of_a_bake_does_no_harm(scene):
    scene.view_settings.view_transform = "AgX"
    while not view_table.is_complete(scene):
        view_table.work(scene)
        scene.view_settings.exposure += 0.3
    colors = some_colors()
    error = np.abs(view_table.of(scene).apply(colors) - displayed(scene, colors)) * 255
    assert np.percentile(error, 99) <= 3.0


def test_what_shapes_the_view_bakes_a_new_table(scene):
    scene.view_settings.view_transform = "AgX"
    seen = {id(view_table.complete(scene).table)}
    for name in ("AgX, look", "AgX, exposure and gamma", "AgX, curves", "Filmic"):
        VIEWS[name](scene)
        assert not view_table.is_complete(scene), name
        table = view_table.complete(scene).table
        assert id(table) not in seen, name
        seen.add(id(table))
    scene.view_settings.curve_mapping.curves[2].points[0].location[1] = 0.1
    assert not view_table.is_complete(scene)


def test_a_coarse_table_serves_until_the_fine_one_is_there(scene):
    scene.view_settings.view_transform = "AgX"
    assert view_table.of(scene) is None
    assert view_table.work(scene), "the first slice is a whole coarse table"
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
