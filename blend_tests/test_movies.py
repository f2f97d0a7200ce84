"""Movies show the frame that they show in Cycles."""

import bpy
import pytest

from addon.engine.workers import image_colors
from addon.export.images import ConvertError
from cards import Cards, differences, node
from helpers import background

pytestmark = pytest.mark.oldest_and_newest

FRAMES = 4


@pytest.fixture
def movie(scene, tmp_path):
    """A movie that gets brighter with each frame."""
    render = scene.render
    scene.world = bpy.data.worlds.new("Brighter")
    if bpy.app.version < (5, 2, 0):
        scene.world.use_nodes = True
    background(scene).inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    strength = background(scene).inputs["Strength"]
    for frame in range(1, FRAMES + 1):
        strength.default_value = 0.2 * frame
        strength.keyframe_insert("default_value", frame=frame)
    render.resolution_x = render.resolution_y = 64
    render.resolution_percentage = 100
    scene.frame_start, scene.frame_end, scene.cycles.samples = 1, FRAMES, 1
    settings = render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "VIDEO"
    settings.file_format, render.ffmpeg.format, render.ffmpeg.codec = "FFMPEG", "MKV", "FFV1"
    render.filepath = str(tmp_path / "movie.mkv")
    bpy.ops.render.render(animation=True)
    if hasattr(settings, "media_type"):
        settings.media_type = "IMAGE"
    settings.file_format = "PNG"
    scene.world = bpy.data.worlds.new("Black")
    scene.frame_set(3)
    return bpy.data.images.load(render.filepath)


def shown(cards, name, image, **user):
    tree, output = cards.add(name)
    texture = node(tree, "ShaderNodeTexImage", image=image)
    for key, value in ({"frame_duration": FRAMES} | user).items():
        setattr(texture.image_user, key, value)
    cards.show(tree, output, texture.outputs["Color"])


@pytest.mark.slow
def test_movies_show_the_frame_that_they_show_in_cycles(scene, movie, tmp_path):
    cards = Cards(scene)
    shown(cards, "third", movie, use_auto_refresh=True)
    shown(cards, "not refreshed", movie)
    shown(cards, "before", movie, frame_start=9)
    shown(cards, "offset", movie, frame_offset=1)
    shown(cards, "cyclic", movie, frame_duration=2, use_cyclic=True)
    other = movie.copy()
    other.colorspace_settings.name = "AgX Base sRGB"
    shown(cards, "another space", other)
    means, warnings = cards.means(tmp_path)
    assert differences(means, tolerance=0.02) == {}
    assert len({round(float(cycles.mean()), 2) for _, cycles in means.values()}) >= 3
    assert warnings == []


def test_a_frame_that_cannot_be_read_is_said(scene, movie, tmp_path, monkeypatch):
    def fail(_image, _stop):
        raise ConvertError("no room")

    monkeypatch.setattr(image_colors, "converted", fail)
    cards = Cards(scene)
    shown(cards, "third", movie)
    _, warnings = cards.means(tmp_path)
    assert any("frame 3 of movie" in text and "no room" in text for text in warnings)
