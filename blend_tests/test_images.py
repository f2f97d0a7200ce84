"""Images come into a scene as Blender has them, and their decoding does not hold up its window."""

import threading
import time

import bpy
import numpy as np
import pytest
import relume

from addon.engine.scene import load_scene
from addon.export import images
from addon.export.images import ImageExporter
from helpers import add_material, add_quad

SIZE = 64


class Recorder:
    """A builder that remembers how images came."""

    def __init__(self):
        self.builder, self.files, self.warnings = relume.SceneBuilder(), [], []

    def add_texture_file(self, name, path, **settings):
        number = self.builder.add_texture_file(name, path, **settings)
        self.files.append(number is not None)
        return number

    def add_texture(self, name, texels, **settings):
        return self.builder.add_texture(name, texels, **settings)

    def warn(self, text):
        self.warnings.append(text)


@pytest.fixture
def save(scene, tmp_path):
    """Writes an image file and opens it anew."""

    def make(file, kind, color="RGB", depth="8", edge=SIZE):
        output = scene.render.image_settings
        output.file_format, output.color_mode = kind, color
        if kind == "PNG":
            output.color_depth = depth
        image = bpy.data.images.new("made", edge, edge, alpha=True)
        pixels = np.random.default_rng(1).random((edge, edge, 4), np.float32)
        image.pixels.foreach_set(pixels.reshape(-1))
        scene.view_settings.view_transform = "Standard"
        image.save_render(str(tmp_path / file), scene=scene)
        bpy.data.images.remove(image)
        return bpy.data.images.load(str(tmp_path / file))

    return make


def exported(image):
    """Whether the file was read without Blender, empty if that was not tried; and what was warned of."""
    recorder = Recorder()
    ImageExporter(recorder).number(image, "test")
    return recorder.files, recorder.warnings


def hash_with(image):
    """Of a scene with the image on a quad."""
    material, tree, output = add_material("Painted")
    texture, diffuse = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "BsdfDiffuse"))
    texture.image = image
    tree.links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    quad = add_quad(bpy.context.scene, "Wall", material=material)
    found = load_scene(bpy.context.scene).hash
    bpy.data.objects.remove(quad)
    bpy.data.materials.remove(material)
    return found


@pytest.mark.parametrize("color", ["BW", "RGB", "RGBA"])
@pytest.mark.parametrize("space", ["sRGB", "Non-Color"])
@pytest.mark.parametrize("alpha", ["STRAIGHT", "CHANNEL_PACKED", "NONE", "PREMUL"])
def test_a_png_has_the_texels_that_blender_reads(save, monkeypatch, color, space, alpha):
    image = save("a.png", "PNG", color)
    image.colorspace_settings.name, image.alpha_mode = space, alpha
    assert exported(image) == ([True] * (alpha in {"STRAIGHT", "CHANNEL_PACKED"}), [])
    found = hash_with(image)
    monkeypatch.setattr(images, "is_plain_file", lambda image: False)
    assert exported(image) == ([], []) and hash_with(image) == found


def test_sixteen_bits_are_left_to_blender(save, monkeypatch):
    image = save("deep.png", "PNG", "RGB", "16")
    assert exported(image) == ([False], []) and image.is_float
    found = hash_with(image)
    monkeypatch.setattr(images, "is_plain_file", lambda image: False)
    assert hash_with(image) == found


def test_what_was_painted_or_packed_is_left_to_blender(save):
    image = save("a.png", "PNG")
    before = hash_with(image)
    image.pixels[0] = 0.123
    assert exported(image) == ([], [])
    painted = hash_with(image)
    image.pack()
    assert exported(image) == ([], []) and hash_with(image) == painted != before


def test_a_missing_file_is_said(save, tmp_path):
    image = save("a.png", "PNG")
    (tmp_path / "a.png").unlink()
    files, warnings = exported(image)
    assert files == [False] and "could not be read" in warnings[0]


@pytest.mark.parametrize(("file", "kind"), [("large.png", "PNG"), ("large.jpg", "JPEG")])
def test_decoding_does_not_hold_pythons_lock(save, file, kind):
    image, waits, took = save(file, kind, edge=3000), [], []

    def export():
        start = time.perf_counter()
        assert exported(image)[0] == [True]
        took.append(time.perf_counter() - start)

    thread = threading.Thread(target=export)
    last = time.perf_counter()
    thread.start()
    while thread.is_alive():
        time.sleep(0.001)
        now = time.perf_counter()
        waits.append(now - last)
        last = now
    thread.join()
    assert max(waits) < took[0] / 2, f"waited {max(waits):.3f} s of {took[0]:.3f} s"
