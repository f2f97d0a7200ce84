"""Pixels of the overlay equal Blender's own display of the same frame, exactly in the given rectangle."""

from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest

from addon.export.view_transform import displayed
from addon.viewport import overlay, texture, view_table
from addon.viewport.camera_frame import Rectangle
from addon.viewport.overlay import Show
from test_view_table import VIEWS

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
    return Show(**{"region": region, "frame": rectangle, "drawn": rectangle, "first": picture, "second": picture} | settings)


def drawn(scene, what):
    """What a region would show, 0..1, [height, width, 3], bottom row first: Blender's own way from the overlay's
    texture, eight bits along the sRGB curve and premultiplied, to the screen, over a grey 3D view."""
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
