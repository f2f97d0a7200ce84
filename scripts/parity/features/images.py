"""Feature scenes of images and attributes of objects. Needs `bpy`."""

import random
import tempfile
from pathlib import Path

import bpy

from . import stage


def image_tiles(scene):
    """A board with an image of two tiles, the third missing."""
    folder = Path(tempfile.mkdtemp(prefix="relume-parity-"))
    for number in (1001, 1002):
        _picture(folder / f"board.{number}.png", number)
    image = bpy.data.images.load(str(folder / "board.1001.png"))
    image.source, image.filepath = "TILED", str(folder / "board.<UDIM>.png")
    if image.tiles.get(1002) is None:
        image.tiles.new(1002)
    image.pack()
    material, tree, texture = _painted(image)
    coordinates, mapping = tree.nodes.new("ShaderNodeTexCoord"), tree.nodes.new("ShaderNodeMapping")
    mapping.inputs["Scale"].default_value = (2.5, 1.0, 1.0)
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    stage.add_ball(scene, "Board", 0.9, material)


def box_projection(scene):
    """A ball with an image from six sides, blended, in the coordinates of another object."""
    empty = bpy.data.objects.new("Place", None)
    empty.location, empty.rotation_euler, empty.scale = (0.3, 0.1, 0.2), (0.4, 0.2, 0.9), (0.7, 0.9, 1.1)
    scene.collection.objects.link(empty)
    folder = Path(tempfile.mkdtemp(prefix="relume-parity-"))
    _picture(folder / "box.png", 5)
    image = bpy.data.images.load(str(folder / "box.png"))
    image.pack()
    material, tree, texture = _painted(image)
    texture.projection, texture.projection_blend = "BOX", 0.4
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    coordinates.object = empty
    tree.links.new(coordinates.outputs["Object"], texture.inputs["Vector"])
    stage.add_ball(scene, "Ball", 0.9, material)


def texture_limit(scene):
    """A ball with an image that Simplify shrinks to an eighth: blocks of random colours become duller."""
    scene.render.use_simplify, scene.cycles.texture_limit_render = True, "128"
    source, image = random.Random(8), bpy.data.images.new("made", 1024, 512)
    blocks = [[(*(source.random() ** 3 for _ in range(3)), 1.0) for _ in range(171)] for _ in range(86)]
    image.pixels.foreach_set([value for y in range(512) for x in range(1024) for value in blocks[y // 6][x // 6]])
    image.pack()
    material, _, texture = _painted(image)
    texture.interpolation = "Closest"
    stage.add_ball(scene, "Ball", 0.9, material)


def object_attributes(scene):
    """Balls of one material, each with the colour of its own custom property."""
    material, tree, output = stage.hunt.new_material("Own")
    diffuse, reader = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeAttribute")
    reader.attribute_type, reader.attribute_name = "OBJECT", "paint"
    tree.links.new(reader.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    for number, color in enumerate(((0.8, 0.1, 0.1), (0.1, 0.7, 0.2), (0.2, 0.3, 0.9))):
        ball = stage.add_ball(scene, f"Ball {number}", 0.4, material)
        ball.location.x += 0.9 * (number - 1)
        ball["paint"] = color


def _picture(path, seed):
    source = random.Random(seed)
    image = bpy.data.images.new("made", 8, 8)
    image.pixels.foreach_set([value for _ in range(64) for value in (*(source.random() for _ in range(3)), 1.0)])
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def _painted(image):
    """A diffuse material with an image, its tree, and the node of the image."""
    material, tree, output = stage.hunt.new_material("Painted")
    diffuse, texture = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeTexImage")
    texture.image = image
    tree.links.new(texture.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material, tree, texture


SCENES = {build.__name__: build for build in (image_tiles, box_projection, texture_limit, object_attributes)}
