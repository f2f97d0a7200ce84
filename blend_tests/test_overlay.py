"""Pixels of the overlay equal Blender's own display of the same frame, exactly in the given rectangle."""

import weakref
from types import SimpleNamespace

import gpu
import numpy as np
import pytest

from addon.export.view_transform import displayed
from addon.viewport import overlay, texture, view_table
from addon.viewport.camera_frame import Rectangle
from addon.viewport.overlay import Show
from views import VIEWS

pytestmark = pytest.mark.usefixtures("gpu_started")

WIDTH, HEIGHT = 64, 48
BACKGROUND = 0.25


@pytest.fixture(autouse=True)
def freed():
    yield
    texture.free()
    view_table.clear()


def frame(seed=1, width=WIDTH, height=HEIGHT, stops=(-8.0, 5.0)):
    """A frame as the native module gives it: scene-linear, bottom row first, opaque; hues of all kinds."""
    image = np.ones((height, width, 4), np.float32)
    image[..., :3] = np.exp2(np.random.default_rng(seed).uniform(*stops, (height, width, 3)))
    image.flags.writeable = False
    return SimpleNamespace(serial=seed, scale=1, image=image)


def show(picture, at=(10, 7), size=None, region=(100, 80), **settings):
    """The frame in a rectangle of a region, its own size unless told otherwise."""
    height, width = picture.image.shape[:2]
    width, height = size or (width, height)
    rectangle = Rectangle(at[0], at[1], at[0] + width, at[1] + height)
    what = {"region": region, "frame": rectangle, "drawn": rectangle, "first": picture, "second": picture}
    return Show(**what | settings)


def drawn(scene, what):
    """Pixels of a region, 0..1, [height, width, 3], bottom row first: Blender's own way from the overlay's texture,
    eight bits along the sRGB curve and premultiplied, to the screen, over a grey 3D view."""
    target = gpu.types.GPUTexture(what.region, format="SRGB8_A8")
    framebuffer = gpu.types.GPUFrameBuffer(color_slots=target)
    with framebuffer.bind():
        framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0))
        overlay.draw(what, view_table.complete(scene))
        pixels = framebuffer.read_color(0, 0, *what.region, 4, 0, "UBYTE")
    stored = np.array(pixels.to_list(), np.float64) / 255.0
    color, alpha = stored[..., :3], stored[..., 3:]
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    merged = BACKGROUND**2.2 * (1.0 - alpha) + linear
    return merged ** (1.0 / 2.2)


def assert_same(found, expected):
    """The goal of the overlay: 1 of 255 on average, 3 at the 99th percentile, of what a screen of 8 bits shows."""
    error = np.abs(np.round(found * 255) - np.round(expected * 255))
    print(f"mean {error.mean():.3f}, p99 {np.percentile(error, 99):.1f}, max {error.max():.0f} of 255")
    assert error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0


def inside(pixels, at=(10, 7), size=(WIDTH, HEIGHT)):
    return pixels[at[1] : at[1] + size[1], at[0] : at[0] + size[0]]


@pytest.mark.parametrize("name", VIEWS)
def test_pixels_are_those_of_blenders_display(scene, name):
    VIEWS[name](scene)
    picture = frame()
    found = drawn(scene, show(picture))
    assert_same(inside(found), displayed(scene, picture.image[..., :3]))
    outside = np.ones(found.shape[:2], bool)
    inside(outside)[:] = False
    assert np.all(np.abs(found[outside] - BACKGROUND) < 1e-6), "nothing is drawn outside of the frame"


@pytest.mark.parametrize("name", VIEWS)
def test_dark_pixels_are_those_of_blenders_display(scene, name):
    VIEWS[name](scene)
    picture = frame()
    picture.image = picture.image.copy()
    picture.image[..., :3] = np.random.default_rng(2).uniform(0.0, 0.02, (HEIGHT, WIDTH, 3))
    assert_same(inside(drawn(scene, show(picture))), display(scene, picture))


def display(scene, picture):
    """Blender's own display of a frame."""
    return displayed(scene, picture.image[..., :3])


def mixed(color, cover):
    """Blender's blending of an overlay's display colour with the grey view behind it."""
    return (BACKGROUND**2.2 * (1.0 - cover) + color**2.2 * cover) ** (1.0 / 2.2)


def test_a_frame_between_pixels_snaps_to_them(scene):
    picture = frame()
    found = drawn(scene, show(picture, at=(10.4, 6.7), size=(64.3, 47.8)))
    assert_same(inside(found), display(scene, picture))


def test_twice_as_large_is_bilinear(scene):
    picture = frame(width=20, height=16)
    found = inside(drawn(scene, show(picture, at=(3, 5), size=(40, 32))), (3, 5), (40, 32))
    padded = np.pad(picture.image[..., :3], ((1, 1), (1, 1), (0, 0)), mode="edge")
    for axis in (0, 1):  # pixel centres lie a quarter texel beside texel centres
        sides = [0.75 * padded + 0.25 * np.roll(padded, side, axis) for side in (1, -1)]
        shape = [edge * (2 if number == axis else 1) for number, edge in enumerate(padded.shape)]
        padded = np.stack(sides, axis + 1).reshape(shape)
    assert_same(found, displayed(scene, padded[2:-2, 2:-2]))


def test_smaller_is_a_mean_and_does_not_glitter(scene):
    picture = frame(width=60, height=48, stops=(-3.0, 0.0))
    found = inside(drawn(scene, show(picture, at=(5, 5), size=(15, 12))), (5, 5), (15, 12))
    mean = displayed(scene, picture.image[..., :3].mean(axis=(0, 1), keepdims=True))
    assert np.abs(found.mean(axis=(0, 1)) - mean[0, 0]).max() < 0.02
    assert found.std() < display(scene, picture).std() / 3, "16 texels and more are in each pixel"


def test_a_frame_larger_than_the_region_is_cut(scene):
    picture = frame(width=40, height=30)
    found = drawn(scene, show(picture, at=(-10, -7), region=(24, 20)))
    assert_same(found, display(scene, picture)[7:27, 10:34])


def test_a_render_border_shows_its_part_at_the_same_place(scene):
    picture = frame()
    found = drawn(scene, show(picture, drawn=Rectangle(26, 19, 58, 43)))
    assert_same(inside(found, (26, 19), (32, 24)), display(scene, picture)[12:36, 16:48])
    inside(found, (26, 19), (32, 24))[:] = BACKGROUND
    assert np.allclose(found, BACKGROUND)


@pytest.mark.parametrize("opacity", [0.0, 0.3, 0.8])
def test_opacity_mixes_with_the_view_behind(scene, opacity):
    picture = frame()
    found = inside(drawn(scene, show(picture, opacity=opacity)))
    assert_same(found, mixed(display(scene, picture), opacity))


def test_film_without_cover_shows_the_view_behind(scene):
    picture = frame()
    image = picture.image.copy()
    cover = np.linspace(0.0, 1.0, WIDTH, dtype=np.float32)[:, None]
    picture.image = image * cover  # premultiplied, as Blender's film
    found = inside(drawn(scene, show(picture)))
    assert_same(found[:, 1:], mixed(displayed(scene, image[..., :3]), cover)[:, 1:])
    assert np.allclose(found[:, 0], BACKGROUND)


def test_values_that_are_no_colours_do_no_harm(scene):
    scene.view_settings.view_transform = "AgX"
    picture = frame()
    image = picture.image.copy()
    image[3, 4, :3], image[5, 6, :3], image[7, 8, :3] = np.nan, np.inf, -1.0
    picture.image = image
    found = inside(drawn(scene, show(picture)))
    assert np.isfinite(found).all()
    assert found[3, 4].max() < 0.02 and found[7, 8].max() < 0.02 and found[5, 6].min() > 0.95
    image[[3, 5, 7], [4, 6, 8]] = found[[3, 5, 7], [4, 6, 8]].mean()
    others = np.ones((HEIGHT, WIDTH), bool)
    others[[3, 5, 7], [4, 6, 8]] = False
    assert_same(found[others], display(scene, picture)[others])


def test_a_wipe_leaves_the_right_side_to_the_view(scene):
    picture = frame()
    found = inside(drawn(scene, show(picture, split=10 + 20)))
    assert_same(found[:, :20], display(scene, picture)[:, :20])
    assert np.allclose(found[:, 20:], BACKGROUND)


def test_two_frames_are_compared_along_a_line(scene):
    first, second = frame(1), frame(2)
    found = inside(drawn(scene, show(first, second=second, mode=overlay.SPLIT, split=10 + 20)))
    assert_same(found[:, :20], display(scene, first)[:, :20])
    assert_same(found[:, 20:], display(scene, second)[:, 20:])


def test_the_difference_of_two_frames(scene):
    first, second = frame(1), frame(2)
    found = inside(drawn(scene, show(first, second=second, mode=overlay.DIFFERENCE, gain=3.0)))
    expected = np.minimum(np.abs(display(scene, first) - display(scene, second)) * 3.0, 1.0)
    assert_same(found, expected)
    same = inside(drawn(scene, show(first, second=frame(1), mode=overlay.DIFFERENCE, gain=3.0)))
    assert same.max() == 0.0


def test_another_view_shows_the_same_frame_anew(scene):
    picture = frame()
    for view in ("Standard", "AgX", "Filmic"):
        scene.view_settings.view_transform = view
        assert_same(inside(drawn(scene, show(picture))), display(scene, picture))
        scene.view_settings.exposure += 1.0
        assert_same(inside(drawn(scene, show(picture))), display(scene, picture))


def test_a_frame_is_uploaded_once(scene):
    picture = frame()
    drawn(scene, show(picture))
    uploaded = texture.of_frame(picture)
    drawn(scene, show(picture))
    assert texture.of_frame(picture) is uploaded
    assert texture.of_frame(frame(2)) is not uploaded


def test_frames_out_of_use_are_let_go(scene):
    first, second = frame(1), frame(2)
    drawn(scene, show(first, second=second))
    pixels, uploaded = weakref.ref(first.image), texture.of_frame(second)
    del first
    assert pixels() is not None
    texture.keep_only([second])
    assert pixels() is None and texture.of_frame(second) is uploaded
    texture.free()
    assert texture.of_frame(second) is not uploaded


def test_blenders_drawing_state_is_as_it_was(scene):
    target = gpu.types.GPUTexture((100, 80), format="RGBA8")
    framebuffer = gpu.types.GPUFrameBuffer(color_slots=target)
    with framebuffer.bind():
        gpu.state.blend_set("MULTIPLY")
        gpu.state.depth_test_set("GREATER")
        gpu.state.depth_mask_set(True)
        overlay.draw(show(frame()), view_table.complete(scene))
        assert gpu.state.active_framebuffer_get() == framebuffer
        assert tuple(gpu.state.viewport_get()) == (0, 0, 100, 80)
        assert gpu.state.blend_get() == "MULTIPLY"
        assert gpu.state.depth_test_get() == "GREATER"
        assert gpu.state.depth_mask_get()
        gpu.state.blend_set("NONE")
        gpu.state.depth_test_set("NONE")
