"""Images in any colour space have the colours that Cycles gives them."""

import bpy
import numpy as np
import pytest
from test_image_textures import save

from addon.engine.workers import image_colors
from addon.export.images import ConvertError
from cards import Cards, differences, node

pytestmark = pytest.mark.oldest_and_newest

SPACES = ["ACEScg", "AgX Base sRGB"]


def picture(tmp_path, space, alpha="STRAIGHT", opaque=True):
    pixels = np.random.default_rng(5).random((4, 4, 4)) * 0.4
    pixels[..., 3] = 1.0 if opaque else 0.4
    save(tmp_path / "a.png", pixels)
    image = bpy.data.images.load(str(tmp_path / "a.png"))
    image.colorspace_settings.name, image.alpha_mode = space, alpha
    return image


def shown(cards, name, image, **settings):
    tree, output = cards.add(name)
    texture = node(tree, "ShaderNodeTexImage", image=image, **settings)
    cards.show(tree, output, texture.outputs["Color"])
    return texture


def test_colour_spaces_are_those_of_cycles(scene, tmp_path):
    cards = Cards(scene)
    for space in SPACES:
        (tmp_path / space).mkdir()
        shown(cards, space, picture(tmp_path / space, space))
    tiled = picture(tmp_path, "Filmic Log")
    (tmp_path / "a.png").rename(tmp_path / "a.1001.png")
    tiled.source, tiled.filepath = "TILED", str(tmp_path / "a.<UDIM>.png")
    shown(cards, "tile", tiled)
    means, warnings = cards.means(tmp_path, samples=128)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


def test_pixels_in_memory_and_their_alpha_are_those_of_cycles(scene, tmp_path):
    cards = Cards(scene)
    packed = picture(tmp_path, "Filmic Log", opaque=False)
    packed.pack()
    shown(cards, "packed", packed)
    painted = packed.copy()
    painted.alpha_mode, painted.pixels[0] = "CHANNEL_PACKED", 0.3
    shown(cards, "painted", painted)
    means, warnings = cards.means(tmp_path, samples=128)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


@pytest.mark.skipif(not hasattr(bpy.data, "colorspace"), reason="files have no working space before Blender 5.0")
def test_srgb_images_have_the_primaries_of_the_working_space(scene, tmp_path):
    bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=False)
    cards = Cards(scene)
    made = bpy.data.images.new("Made", 4, 4)
    made.pixels.foreach_set([0.8, 0.2, 0.1, 1.0] * 16)
    shown(cards, "file", picture(tmp_path, "sRGB"))
    shown(cards, "made", made)
    shown(cards, "linear", picture(tmp_path, "Linear Rec.709"))
    assert differences(cards.means(tmp_path, samples=128)[0], tolerance=0.03) == {}


def test_an_image_that_cannot_be_converted_is_said(scene, tmp_path, monkeypatch):
    def fail(_image, _stop):
        raise ConvertError("no room")

    monkeypatch.setattr(image_colors, "converted", fail)
    cards = Cards(scene)
    shown(cards, "color", picture(tmp_path, "Filmic Log"))
    _, warnings = cards.means(tmp_path)
    assert len(warnings) == 1 and "'Filmic Log' of image 'a.png' is taken as sRGB (no room)" in warnings[0]
