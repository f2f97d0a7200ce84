"""Images are as large as Simplify leaves them for final renders, wherever they are shown."""

import bpy
import numpy as np
import pytest
from test_image_textures import save, tiled

from addon.export.images import texture_size
from cards import Cards, differing_pixels, node
from helpers import add_light, add_quad, add_sky, add_world, both_lit, exported

pytestmark = pytest.mark.every_version
LIMITS = [
    {"texture_limit_render": "128"},
    *([{"texture_resolution_render": 0.3}] if bpy.app.version >= (5, 3, 0) else []),
]


def limit(scene, limits, use_simplify=True):
    scene.render.use_simplify = use_simplify
    for name, value in limits.items():
        setattr(scene.cycles, name, value)


def noise(width, height, channels, seed=1):
    """Values that no neighbour shares; alpha 1 where it is not asked for."""
    pixels = np.random.default_rng(seed).random((height, width, 4))
    pixels[..., channels:] = 1.0
    return pixels


@pytest.fixture
def pictures(tmp_path):
    """Images of all kinds, larger than the limits; a side of one is no power of two."""
    save(tmp_path / "bytes.png", noise(300, 256, 3))
    save(tmp_path / "alpha.png", noise(256, 256, 4))
    files = {name: bpy.data.images.load(str(tmp_path / f"{name}.png")) for name in ("bytes", "alpha")}
    data = files["bytes"].copy()
    data.colorspace_settings.name = "Non-Color"
    packed = files["alpha"].copy()
    packed.pack()
    made = bpy.data.images.new("floats", 256, 160, float_buffer=True)
    made.pixels.foreach_set(np.float32(noise(256, 160, 3)).reshape(-1))
    small = bpy.data.images.new("small", 32, 32)
    small.pixels.foreach_set(np.float32(noise(32, 32, 3)).reshape(-1))
    return files | {"data": data, "packed": packed, "floats": made, "small": small}


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("use_simplify", [True, False])
def test_images_are_as_large_as_in_cycles(scene, tmp_path, pictures, limits, use_simplify):
    """Each card shows a corner, a pixel of the picture for each of the image."""
    limit(scene, limits, use_simplify)
    cards = Cards(scene)
    for name, image in pictures.items():
        tree, output = cards.add(name)
        coordinates = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        scale = (8.0 / image.size[0], 8.0 / image.size[1], 1.0)
        mapping = node(tree, "ShaderNodeMapping", {"Vector": coordinates, "Scale": scale})
        texture = node(tree, "ShaderNodeTexImage", {"Vector": mapping.outputs[0]}, image=image, interpolation="Closest")
        cards.show(tree, output, texture.outputs["Color"])
    found, warnings = differing_pixels(cards, tmp_path, tolerance=0.03)
    assert (found, warnings) == ({}, [])


def test_tiles_are_limited_each(scene, tmp_path):
    image = tiled(tmp_path)
    for tile in image.tiles:
        save(tmp_path / f"a.{tile.number}.png", noise(256, 256, 3, tile.number))
    limit(scene, LIMITS[0])
    cards = Cards(scene)
    for shift in (0.0, 1.0):
        tree, output = cards.add(f"{shift}")
        inputs = {"Location": (shift, 0.0, 0.0), "Scale": (8.0 / 256.0, 8.0 / 256.0, 1.0)}
        coordinates = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        mapping = node(tree, "ShaderNodeMapping", {"Vector": coordinates, **inputs})
        texture = node(tree, "ShaderNodeTexImage", {"Vector": mapping.outputs[0]}, image=image, interpolation="Closest")
        cards.show(tree, output, texture.outputs["Color"])
    found, warnings = differing_pixels(cards, tmp_path, tolerance=0.03)
    assert (found, warnings) == ({}, [])


@pytest.mark.parametrize("is_rendered", [False, True])
def test_worlds_are_limited_too(scene, tmp_path, is_rendered):
    """The world as the camera sees it, some twelve of its pixels across; one is read, the other Cycles renders."""
    save(tmp_path / "sky.png", noise(512, 256, 3))
    texture, _ = add_sky(add_world(scene, strength=1.0), tmp_path / "sky.png")
    tree = texture.id_data
    if is_rendered:
        (link,) = texture.outputs[0].links
        tree.links.new(node(tree, "ShaderNodeGamma", {"Color": texture.outputs[0]}).outputs[0], link.to_socket)
    limit(scene, LIMITS[0])
    scene.render.resolution_x, scene.render.resolution_y = 32, 32
    scene.camera.data.angle, scene.camera.rotation_euler = 0.15, (1.5, 0.0, 1.0)
    add_quad(scene, size=0.01).location = (0.0, 0.0, -50.0)
    ours, cycles = both_lit(scene, tmp_path, samples=64)
    assert np.abs(ours - cycles).mean() < 0.02 * cycles.mean()
    unlimited = noise(512, 256, 3)[..., :3].std()
    assert cycles.std() < 0.5 * unlimited  # The limit changes what is seen.


def test_a_gobo_is_limited_too(scene):
    """It shines as an image that was shrunk before."""
    add_quad(scene)
    lamp = add_light(scene, "AREA").data
    if bpy.app.version < (5, 2, 0):
        lamp.use_nodes = True
    tree = lamp.node_tree
    emission = next(each for each in tree.nodes if each.bl_idname == "ShaderNodeEmission")
    values = np.random.default_rng(3).integers(0, 64, (128, 2, 128, 2, 4)) * 4
    images = []
    for size, pixels in ((256, values), (128, values.mean(axis=(1, 3)))):
        image = bpy.data.images.new("gobo", size, size)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.float32(pixels.reshape(size, size, 4)) / 255.0
        pixels[..., 3] = 1.0
        image.pixels.foreach_set(pixels.reshape(-1))
        images.append(image)
    texture = node(tree, "ShaderNodeTexImage", image=images[0])
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])

    def shown():
        bpy.context.view_layer.update()
        return exported(scene)["lights"][0]["map"]["map"]

    whole = shown()
    limit(scene, LIMITS[0])
    limited = shown()
    texture.image = images[1]
    assert limited == shown() != whole


def test_a_limit_is_a_change_of_settings(scene):
    before = texture_size(scene)
    limit(scene, LIMITS[0])
    assert (before, texture_size(scene)) == (None, (128, 1.0))
