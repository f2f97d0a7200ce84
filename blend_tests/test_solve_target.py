"""Target pictures and masks are read as the light that they show; where objects are seen is found."""

import bpy
import numpy as np
import pytest

from addon.engine.solve.region_masks import MaskSubject, masks
from addon.export.target import TargetError, from_srgb, pixels_of, read_mask, read_target, resized, to_srgb
from addon.export.view_transform import displayed
from helpers import add, add_material, add_quad

SIZE = (64, 48)


def image_of(pixels, name="Target", is_float=False):
    """An image data-block of [height, width, 3 or 4], top row first."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, float_buffer=is_float, alpha=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., : pixels.shape[2]] = pixels
    image.pixels.foreach_set(rgba[::-1].reshape(-1))
    return image


def light(low=-5.0, high=2.0):
    """Scene-linear colours, greys and tints."""
    random = np.random.default_rng(1)
    grey = np.exp2(random.uniform(low, high, (SIZE[1], SIZE[0], 1)))
    return (grey * random.uniform(0.6, 1.0, (SIZE[1], SIZE[0], 3))).astype(np.float32)


@pytest.mark.parametrize(
    ("view", "settings"),
    [("Standard", {}), ("Standard", {"exposure": 1.0, "gamma": 1.5}), ("Filmic", {}), ("AgX", {"exposure": -0.5})],
)
def test_what_the_scene_displays_is_turned_back_into_light(scene, view, settings):
    scene.view_settings.view_transform = view
    for name, value in settings.items():
        setattr(scene.view_settings, name, value)
    linear = light(high=-2.0) if view == "Standard" else light()
    shown = displayed(scene, linear[::-1])[::-1]
    found, words, is_doubtful = read_target(scene, pixels_of(image_of(shown)), "AUTO", SIZE)
    assert words == f"Target read as this scene displays it ({view})" and not is_doubtful
    again = displayed(scene, found[::-1])[::-1]
    # Eight bits of the image, and the size of Blender's own table of AgX.
    error = np.abs(again - shown) * 255
    assert error.mean() < 1.0 and np.percentile(error, 99) < 5.0
    assert np.median(np.abs(found - linear) / linear) < 0.05


@pytest.mark.parametrize("change", [{"look": "AgX - Punchy"}, {"view_transform": "False Color"}])
def test_a_view_that_cannot_be_undone_is_said(scene, change):
    scene.view_settings.view_transform = "AgX"
    for name, value in change.items():
        setattr(scene.view_settings, name, value)
    found, words, is_doubtful = read_target(scene, pixels_of(image_of(np.full((48, 64, 3), 0.5))), "AUTO", SIZE)
    assert is_doubtful and "plain sRGB" in words and "cannot be undone" in words
    assert np.allclose(found, from_srgb(np.array(128 / 255)), atol=2e-3)


def test_float_images_are_light_and_eight_bits_can_be_told_to_be(scene):
    scene.view_settings.view_transform = "AgX"
    linear = light()
    found, words, _ = read_target(scene, pixels_of(image_of(linear, is_float=True)), "AUTO", SIZE)
    assert np.allclose(found, linear) and "scene-linear" in words
    grey = image_of(np.full((48, 64, 3), 0.5))
    plain, words, _ = read_target(scene, pixels_of(grey), "SRGB", SIZE)
    assert "plain sRGB" in words and np.allclose(plain, from_srgb(np.array(128 / 255)), atol=2e-3)


def test_sixteen_bit_files_are_as_displayed(scene, tmp_path):
    scene.view_settings.view_transform = "Standard"
    output = scene.render.image_settings
    output.file_format, output.color_depth = "PNG", "16"
    linear = light(high=-2.0)
    image_of(linear, is_float=True).save_render(str(tmp_path / "target.png"), scene=scene)
    found, words, _ = read_target(scene, pixels_of(bpy.data.images.load(str(tmp_path / "target.png"))), "AUTO", SIZE)
    assert "displays" in words and np.allclose(found, linear, rtol=1e-2, atol=1e-3)


def test_resizing_keeps_means_and_places():
    random = np.random.default_rng(2).uniform(size=(96, 128, 3))
    half = resized(random, SIZE)
    assert np.allclose(half, random.reshape(48, 2, 64, 2, 3).mean(axis=(1, 3)))
    odd = resized(random, (50, 37))
    assert np.allclose(odd.mean(axis=(0, 1)), random.mean(axis=(0, 1)))
    large = resized(random, (256, 192))
    assert np.allclose(large[::2, ::2], random)


def test_srgb_there_and_back():
    values = np.linspace(0.0, 1.0, 100)
    assert np.allclose(to_srgb(from_srgb(values)), values, atol=1e-7)


def nan_pixel(pixels):
    pixels[3, 4, 1] = np.nan
    return pixels


@pytest.mark.parametrize(
    ("pixels", "says"),
    [
        (np.zeros((48, 64, 3)), "target 'Target' is all black"),
        (nan_pixel(np.ones((48, 64, 3))), "target 'Target' has pixels that are not numbers"),
        (np.ones((64, 64, 3)), "'Target' is 64 x 64 and the camera's frame 64 x 48: crop it"),
    ],
)
def test_bad_targets_are_refused_in_one_line(scene, pixels, says):
    with pytest.raises(TargetError, match=says):
        read_target(scene, pixels_of(image_of(pixels, is_float=True)), "AUTO", SIZE)


def test_a_missing_file_is_refused(scene, tmp_path):
    image = image_of(np.ones((48, 64, 3)))
    image.source, image.filepath = "FILE", str(tmp_path / "gone.png")
    image.reload()
    with pytest.raises(TargetError, match="is its file still there"):
        read_target(scene, pixels_of(image), "AUTO", SIZE)


def test_a_mask_is_white_times_alpha(scene):
    pixels = np.zeros((96, 128, 4))
    pixels[:48, :, :3], pixels[..., 3] = 1.0, 0.5
    mask = read_mask(pixels_of(image_of(pixels, is_float=True)), SIZE)
    assert mask.shape == (48, 64, 1) and np.allclose(mask[:24], 0.5) and not mask[24:].any()
    with pytest.raises(TargetError, match="all black"):
        read_mask(pixels_of(image_of(np.zeros((48, 64, 3)))), SIZE)


def all_masks(scene, *wanted):
    """The masks, in slices as the window gets them."""
    aspect = scene.render.resolution_x / scene.render.resolution_y
    *slices, found = masks(scene.session_uid, list(wanted), aspect)
    assert all(part is None for part in slices)
    return [found[seen][..., 0] for seen in wanted]


@pytest.mark.parametrize("kind", ["PERSP", "ORTHO"])
def test_objects_and_materials_are_seen_where_they_are(scene, kind):
    scene.camera.data.type = kind
    scene.camera.data.ortho_scale = 4.0
    red = add_material("Red")[0]
    red.pass_index = 3
    left = add_quad(scene, "Left", 1.0, red)
    left.location = (-1.0, 0.5, 0.0)
    right = add(scene, "Right", left.data.copy())
    right.data.materials.clear()
    right.location, right.pass_index = (1.0, -0.5, 0.0), 7
    bpy.context.view_layer.update()
    seen = all_masks(
        scene,
        MaskSubject("OBJECT", "Left"),
        MaskSubject("OBJECT_INDEX", 7),
        MaskSubject("MATERIAL", "Red"),
        MaskSubject("MATERIAL_INDEX", 3),
    )
    height, width = seen[0].shape
    places = [np.argwhere(mask).mean(axis=0) / (height, width) for mask in seen]
    assert places[0][0] < 0.5 and places[0][1] < 0.5, "top left"
    assert places[1][0] > 0.5 and places[1][1] > 0.5, "bottom right"
    assert (seen[2] == seen[0]).all() and (seen[3] == seen[0]).all()
    # A metre at 5 m of a 50 mm lens on 36 mm film, or of 4 m.
    share = 1.0 / (5.0 * 36.0 / 50.0) if kind == "PERSP" else 0.25
    assert abs(seen[0].any(axis=0).sum() - share * width) <= 1.5


def test_what_is_not_seen_has_an_empty_mask(scene):
    (mask,) = all_masks(scene, MaskSubject("OBJECT", "Nobody"))
    assert not mask.any() and str(MaskSubject("OBJECT_INDEX", 7)) == "object index 7"


def test_without_a_target_there_is_nothing_to_compare(baked):
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.relume.show_target()
