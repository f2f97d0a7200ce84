"""Images come into a scene as Blender has them, and their decoding does not hold up its window."""

import threading
import time

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import images
from addon.export.images import ImageExporter
from helpers import add_material, add_quad, render_cycles

pytestmark = pytest.mark.oldest_and_newest

SIZE = 64


class Recorder:
    """A builder that remembers how images came."""

    def __init__(self):
        self.builder, self.files, self.warnings = relume.SceneBuilder(), [], []

    def add_texture_file(self, name, file, **settings):
        number = self.builder.add_texture_file(name, file, **settings)
        self.files.append(number is not None)
        return number

    def add_texture(self, name, texels, **settings):
        return self.builder.add_texture(name, texels, **settings)

    def warn(self, text):
        self.warnings.append(text)


@pytest.fixture
def save(scene, tmp_path):
    """Writes an image file, of random colours up to `brightest`, and opens it anew."""

    def make(file, kind, color="RGB", depth="8", edge=SIZE, codec=None, brightest=1.0):
        output = scene.render.image_settings
        if hasattr(output, "media_type"):
            output.media_type = "IMAGE"
        output.file_format, output.color_mode = kind, color
        if kind in {"PNG", "TIFF", "OPEN_EXR"}:
            output.color_depth = depth
        if codec:
            setattr(output, {"TIFF": "tiff_codec", "OPEN_EXR": "exr_codec"}[kind], codec)
        image = bpy.data.images.new("made", edge, edge, alpha=True, float_buffer=True)
        pixels = np.random.default_rng(1).random((edge, edge, 4), np.float32)
        pixels[..., :3] *= brightest
        pixels[0, :, 3], pixels[1, :, 3] = 0.0, 1.0
        image.pixels.foreach_set(pixels.reshape(-1))
        scene.view_settings.view_transform = "Standard"
        image.save_render(str(tmp_path / file), scene=scene)
        bpy.data.images.remove(image)
        return bpy.data.images.load(str(tmp_path / file))

    return make


def exported(image):
    """Files by whether they were read without Blender, empty if that was not tried; and warnings."""
    recorder = Recorder()
    material, tree, _ = add_material("User")
    ImageExporter(recorder, 1).number(image, "test", tree.nodes.new("ShaderNodeTexImage").image_user)
    bpy.data.materials.remove(material)
    return recorder.files, recorder.warnings


def texels(image, number=0):
    """Texels of an image, the only one, from a scene with it on a quad; or of another texture of the scene."""
    material, tree, output = add_material("Painted")
    texture, diffuse = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "BsdfDiffuse"))
    texture.image = image
    tree.links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    quad = add_quad(bpy.context.scene, "Wall", material=material)
    found = load_scene(bpy.context.scene).texels(number)
    bpy.data.objects.remove(quad)
    bpy.data.materials.remove(material)
    return found


def left_to_blender(monkeypatch):
    """No file is decoded but by Blender."""
    monkeypatch.setattr(images, "colors_of_file", lambda image: None)


def check_same(image, monkeypatch, space, alpha):
    """The native module has the texels that Blender reads."""
    image.colorspace_settings.name, image.alpha_mode = space, alpha
    assert exported(image) == ([True], [])
    found = texels(image)
    left_to_blender(monkeypatch)
    assert exported(image) == ([], [])
    wanted = texels(image)
    assert found.dtype == wanted.dtype and found.std() > 0.05
    if found.dtype == np.float32 and space == "sRGB":
        # Blender's curve is a quick approximation, here is the formula itself.
        np.testing.assert_allclose(found, wanted, rtol=1e-4, atol=1e-4)
    else:
        np.testing.assert_array_equal(found, wanted)


SPACES = pytest.mark.parametrize("space", ["sRGB", "Non-Color", "Linear Rec.709"])
ALPHA_MODES = pytest.mark.parametrize("alpha", ["STRAIGHT", "CHANNEL_PACKED", "NONE", "PREMUL"])


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
@pytest.mark.parametrize("color", ["BW", "RGB", "RGBA"])
@pytest.mark.parametrize("depth", ["8", "16"])
@SPACES
@ALPHA_MODES
def test_whole_numbers_have_the_texels_that_blender_reads(save, monkeypatch, kind, color, depth, space, alpha):
    check_same(save(f"a.{kind.lower()}", kind, color, depth), monkeypatch, space, alpha)


@pytest.mark.parametrize("codec", ["NONE", "DEFLATE", "LZW", "PACKBITS"])
def test_tiffs_of_every_compression_are_read(save, monkeypatch, codec):
    check_same(save("a.tif", "TIFF", "RGBA", "16", codec=codec), monkeypatch, "Non-Color", "STRAIGHT")


@pytest.mark.parametrize(("color", "depth"), [("BW", "16"), ("RGB", "16"), ("RGBA", "32")])
@SPACES
@ALPHA_MODES
def test_an_exr_has_the_texels_that_blender_reads(save, monkeypatch, color, depth, space, alpha):
    image = save("a.exr", "OPEN_EXR", color, depth, codec="ZIP", brightest=8.0)
    check_same(image, monkeypatch, space, alpha)


@pytest.mark.parametrize("codec", ["NONE", "ZIPS", "PIZ", "RLE", "PXR24"])
@pytest.mark.parametrize("depth", ["16", "32"])
def test_exrs_of_most_compressions_are_read(save, monkeypatch, codec, depth):
    image = save("a.exr", "OPEN_EXR", "RGBA", depth, codec=codec, brightest=8.0)
    check_same(image, monkeypatch, "Linear Rec.709", "PREMUL")


@SPACES
def test_a_radiance_picture_has_the_texels_that_blender_reads(save, monkeypatch, space):
    check_same(save("a.hdr", "HDR", brightest=8.0), monkeypatch, space, "STRAIGHT")


@pytest.mark.parametrize("head", [b"GAMMA=2.2\n", b"EXPOSURE=2.5\n", b"PRIMARIES=0 0 1 0 0 1 .3 .3\n"])
def test_corrections_of_radiance_pictures_are_not_heeded(tmp_path, monkeypatch, head):
    file = tmp_path / "a.hdr"
    pixels = np.random.default_rng(1).integers(100, 140, 6 * 6 * 4, np.uint8)
    file.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n" + head + b"\n-Y 6 +X 6\n" + pixels.tobytes())
    check_same(bpy.data.images.load(str(file)), monkeypatch, "Linear Rec.709", "STRAIGHT")


@pytest.mark.parametrize(("mark", "names"), [("<UDIM>", ("1001", "1012")), ("<UVTILE>", ("u1_v1", "u2_v2"))])
@pytest.mark.parametrize("first", [0, 1])
def test_the_first_tile_has_the_texels_that_blender_reads(save, monkeypatch, tmp_path, mark, names, first):
    for name in names:
        bpy.data.images.remove(save(f"a.{name}.png", "PNG", brightest=0.5 if name == names[0] else 1.0))
    image = bpy.data.images.load(str(tmp_path / f"a.{names[0]}.png"))
    image.source, image.filepath = "TILED", str(tmp_path / f"a.{mark}.png")
    image.tiles.new(1012)
    if first:
        image.tiles.remove(image.tiles.get(1001))
    assert exported(image) == ([True], ["test: " + images.note_on(image)])
    left_to_blender(monkeypatch)
    assert exported(image)[0] == []
    found = texels(image, number=1)
    pixels = np.empty(SIZE * SIZE * 4, np.float32)
    image.pixels.foreach_get(pixels)
    np.testing.assert_array_equal(found.reshape(-1), np.rint(255 * pixels))
    assert (found[..., :3].max() > 200) == bool(first)


@pytest.mark.parametrize(("frame", "shown"), [(1, 2), (3, 4), (9, 5), (-5, 1)])
@pytest.mark.parametrize("is_cyclic", [False, True])
def test_an_image_of_a_sequence_is_that_of_its_frame_in_cycles(scene, tmp_path, frame, shown, is_cyclic):
    for number in range(1, 8):
        image = bpy.data.images.new("made", 8, 8)
        image.pixels.foreach_set(np.tile(np.float32([0.1 * number] * 3 + [1.0]), 8 * 8))
        image.filepath_raw, image.file_format = str(tmp_path / f"v2_{number:03}.png"), "PNG"
        image.save()
        bpy.data.images.remove(image)
    image = bpy.data.images.load(str(tmp_path / "v2_003.png"))
    image.source, image.colorspace_settings.name = "SEQUENCE", "Non-Color"
    material, tree, output = add_material("Film")
    texture, emission = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Emission"))
    texture.image, settings = image, texture.image_user
    settings.frame_duration, settings.frame_start, settings.frame_offset = 4, 1, 1
    settings.use_auto_refresh, settings.use_cyclic = True, is_cyclic
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(scene, "Screen", size=20.0, material=material)
    scene.frame_set(frame)
    loaded = load_scene(scene)
    assert loaded.warnings == []
    found = loaded.texels(0)[0, 0, 0] / 255
    assert found == pytest.approx(render_cycles(scene, samples=1)[24, 32, 0], abs=2e-3)
    assert is_cyclic or found == pytest.approx(0.1 * shown, abs=3e-3)


def test_a_multi_layer_exr_is_left_to_blender(scene, tmp_path):
    output = scene.render.image_settings
    if hasattr(output, "media_type"):
        output.media_type = "MULTI_LAYER_IMAGE"
    output.file_format = "OPEN_EXR_MULTILAYER"
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    scene.render.resolution_x = scene.render.resolution_y = 8
    scene.render.filepath = str(tmp_path / "a.exr")
    bpy.ops.render.render(write_still=True)
    assert exported(bpy.data.images.load(scene.render.filepath))[0] == [False]


def test_what_was_painted_is_left_to_blender_until_it_is_packed(save, monkeypatch):
    image = save("a.png", "PNG")
    before = texels(image)
    image.pixels[0] = 0.123
    assert exported(image) == ([], [])
    painted = texels(image)
    image.pack()
    assert exported(image) == ([True], [])
    np.testing.assert_array_equal(texels(image), painted)
    assert (painted != before).any()


@pytest.mark.parametrize(
    ("file", "kind", "depth"), [("a.png", "PNG", "16"), ("a.exr", "OPEN_EXR", "32"), ("a.hdr", "HDR", "8")]
)
def test_a_packed_file_has_the_texels_that_blender_reads(save, monkeypatch, tmp_path, file, kind, depth):
    image = save(file, kind, depth=depth)
    image.pack()
    (tmp_path / file).unlink()
    check_same(image, monkeypatch, "Linear Rec.709", "STRAIGHT")


@pytest.mark.parametrize("space", ["Linear Rec.709", "Non-Color"])
@pytest.mark.parametrize("is_seen_through", [False, True])
def test_straight_alpha_of_floats_in_memory_is_taken_as_in_cycles(scene, tmp_path, space, is_seen_through):
    image = bpy.data.images.new("Made", 4, 4, alpha=True, float_buffer=True)
    image.colorspace_settings.name, image.alpha_mode = space, "STRAIGHT"
    image.pixels.foreach_set([0.2, 0.5, 0.9, 0.4] * 16)
    material, tree, output = add_material()
    texture, emission = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Emission"))
    texture.image = image
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    if is_seen_through:
        tree.links.new(texture.outputs["Alpha"], emission.inputs["Strength"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=40.0, material=material)
    scene.render.resolution_x = scene.render.resolution_y = 8
    relume.bake(load_scene(scene), tmp_path / "bake", {"samples": 1}).wait()
    ours = relume.Relighter(tmp_path / "bake").relight("[]", denoise=False)["combined"]
    assert ours[4, 4] == pytest.approx(render_cycles(scene, samples=1)[4, 4], abs=2e-3)


def test_an_image_made_in_blender_keeps_what_its_packed_file_lacks(scene):
    image = bpy.data.images.new("Opaque", 8, 8)
    image.pixels.foreach_set(np.random.default_rng(1).random(8 * 8 * 4, np.float32))
    image.pack()
    assert exported(image) == ([], [])
    assert texels(image)[..., 3].std() > 10


@pytest.mark.skipif(not hasattr(bpy.data, "colorspace"), reason="files have no working space before Blender 5.0")
@pytest.mark.parametrize("working_space", ["Linear Rec.2020", "ACEScg"])
@pytest.mark.parametrize(("kind", "depth"), [("PNG", "8"), ("PNG", "16"), ("OPEN_EXR", "32"), ("HDR", "8")])
@ALPHA_MODES
def test_files_have_blenders_texels_in_another_working_space(save, monkeypatch, working_space, kind, depth, alpha):
    image = save(f"a.{kind.lower()}", kind, "RGB" if kind == "HDR" else "RGBA", depth)
    bpy.ops.wm.set_working_color_space(working_space=working_space, convert_colors=False)
    image.alpha_mode = alpha
    found = texels(image)
    assert exported(image) == ([] if (kind, depth) == ("PNG", "8") else [True], [])
    left_to_blender(monkeypatch)
    np.testing.assert_allclose(found, texels(image), rtol=1e-4, atol=1e-4)


def test_a_missing_file_is_said(save, tmp_path):
    image = save("a.png", "PNG")
    (tmp_path / "a.png").unlink()
    files, warnings = exported(image)
    assert files == [False] and "could not be read" in warnings[0]


LARGE = [("PNG", "8"), ("PNG", "16"), ("JPEG", "8"), ("OPEN_EXR", "16"), ("TIFF", "16"), ("HDR", "8")]
PACKED = ("PNG", "16")
"""The one of them that is also packed: the bytes are decoded as those of a file."""


@pytest.mark.parametrize(("kind", "depth", "is_packed"), [*((*large, False) for large in LARGE), (*PACKED, True)])
def test_decoding_does_not_hold_pythons_lock(save, kind, depth, is_packed):
    image, waits, took = save(f"large.{kind.lower()}", kind, depth=depth, edge=2500), [], []
    if is_packed:
        image.pack()

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
