"""Targets and masks are read in another Blender, as this one would read them."""

import time

import bpy
import numpy as np
import pytest

from addon.engine.workers.pictures import Reading
from addon.export.target import pixels_of, read_mask, read_target

SIZE = (64, 48)


def image_of(value=0.5, size=(128, 96), name="Painting"):
    """An image data-block, brighter from left to right."""
    image = bpy.data.images.new(name, *size)
    pixels = np.ones((size[1], size[0], 4), np.float32)
    pixels[..., :3] = np.linspace(0.1, value, size[0])[:, None]
    image.pixels.foreach_set(pixels.reshape(-1))
    return image


def saved(path, **settings):
    """An image that lies in a file and was not looked at."""
    image = image_of(**settings)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return bpy.data.images.load(str(path))


def read(scene, image, colors="AUTO"):
    """Waits for the end."""
    reading = Reading(scene, image, SIZE, colors)
    while reading.step():
        time.sleep(0.01)
    return reading


@pytest.mark.parametrize("view", ["Standard", "AgX"])
def test_a_file_is_read_without_opening_it_here(scene, tmp_path, view):
    scene.view_settings.view_transform, scene.view_settings.exposure = view, 0.5
    image = saved(tmp_path / "target.png")
    reading = read(scene, image)
    assert not image.has_data and reading.error == ""
    pixels, words, is_doubtful = read_target(scene, pixels_of(image), "AUTO", SIZE)
    assert np.allclose(reading.found.pixels, pixels, rtol=1e-5, atol=1e-6)
    assert (reading.found.words, reading.found.is_doubtful) == (words, is_doubtful)


def test_what_was_painted_counts_and_not_the_file(scene, tmp_path):
    scene.view_settings.view_transform = "Standard"
    image = saved(tmp_path / "target.png")
    image.pixels.foreach_set(np.full(128 * 96 * 4, 0.25, np.float32))
    found = read(scene, image).found
    assert np.ptp(found.pixels) == 0.0


def test_a_packed_picture_needs_no_file(scene, tmp_path):
    image = saved(tmp_path / "target.png")
    image.pack()
    (tmp_path / "target.png").unlink()
    image.buffers_free()
    assert not image.has_data
    reading = read(scene, image)
    assert reading.error == "" and reading.found.pixels.shape == (48, 64, 3)


def test_a_view_that_cannot_be_undone_is_said_by_the_other_blender_too(scene, tmp_path):
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Punchy"
    found = read(scene, saved(tmp_path / "target.png")).found
    assert found.is_doubtful and "cannot be undone" in found.words


def test_a_mask_is_read(scene, tmp_path):
    image = saved(tmp_path / "mask.png")
    found = read(scene, image, colors=None).found
    assert found.pixels.shape == (48, 64, 1) and np.allclose(found.pixels, read_mask(pixels_of(image), SIZE))


def missing(image, _path):
    image.filepath = "//gone.png"
    return "'Painting' has no pixels: is its file still there"


def damaged(_image, path):
    path.write_bytes(b"no picture")
    return "'Painting' has no pixels: is its file still there"


def square(image, path):
    image.filepath = saved(path.with_name("square.png"), size=(64, 64), name="Square").filepath
    return "'Painting' is 64 x 64 and the camera's frame 64 x 48: crop it"


@pytest.mark.parametrize("spoil", [missing, damaged, square])
def test_what_cannot_be_read_is_one_clear_line(scene, tmp_path, spoil):
    image = saved(tmp_path / "target.png")
    image.name = "Painting"
    says = spoil(image, tmp_path / "target.png")
    reading = read(scene, image)
    assert reading.found is None and says in reading.error


def test_an_image_that_was_deleted_meanwhile_is_said(scene):
    image = image_of()
    reading = Reading(scene, image, SIZE, "AUTO")
    bpy.data.images.remove(image)
    assert not reading.step() and reading.error == "the image was deleted while it was read"


def test_closing_ends_the_other_blender(scene):
    reading = Reading(scene, image_of(), SIZE, "AUTO")
    while reading._worker is None:
        assert reading.step()
        time.sleep(0.01)
    reading.close()
    reading._worker._process.wait(60.0)
    assert not reading.step()
