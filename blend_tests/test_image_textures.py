"""Tiles and projections of images are those of Cycles."""

import math

import bpy
import numpy as np
import pytest
from mathutils import Euler

from addon.engine.reading.scene import load_scene
from addon.engine.world import worlds
from cards import Cards, differences, node
from helpers import add_quad, add_world, both_lit

pytestmark = pytest.mark.every_version

TILES = (1001, 1002, 1012)


def save(path, pixels):
    """A picture file of floats 0 to 1 [height, width, 4], bottom row first."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new("made", width, height, alpha=True)
    image.pixels.foreach_set(np.float32(pixels).reshape(-1))
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


def tiled(tmp_path, mark="<UDIM>", names=None):
    """An image of three tiles, each of other colours."""
    for number, name in zip(TILES, names or map(str, TILES), strict=True):
        pixels = np.random.default_rng(number).random((4, 4, 4))
        pixels[..., 3] = 1.0
        save(tmp_path / f"a.{name}.png", pixels)
    image = bpy.data.images.load(str(tmp_path / f"a.{next(iter(names or map(str, TILES)))}.png"))
    image.source, image.filepath = "TILED", str(tmp_path / f"a.{mark}.png")
    for number in TILES[1:]:
        if image.tiles.get(number) is None:
            image.tiles.new(number)
    return image


def shifted(tree, shift):
    """UV coordinates that are moved."""
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    return node(tree, "ShaderNodeMapping", {"Vector": coordinates.outputs["UV"], "Location": shift}).outputs[0]


@pytest.mark.parametrize(("mark", "names"), [("<UDIM>", None), ("<UVTILE>", ("u1_v1", "u2_v1", "u2_v2"))])
@pytest.mark.parametrize("is_packed", [False, True])
def test_tiles_are_those_of_cycles(scene, tmp_path, mark, names, is_packed):
    image = tiled(tmp_path, mark, names)
    if is_packed:
        image.pack()
    cards = Cards(scene)
    for shift in ((0, 0), (1, 0), (1, 1), (0, 1), (11, 0), (-1.5, 0), (-0.5, 0), (0.5, 0.5)):
        tree, output = cards.add(f"{shift}")
        texture = node(tree, "ShaderNodeTexImage", {"Vector": shifted(tree, (*shift, 0.0))}, image=image)
        texture.extension = "EXTEND"
        cards.show(tree, output, texture.outputs["Color"])
    means, warnings = cards.means(tmp_path, samples=128)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


def test_a_tile_without_its_file_is_magenta_and_said(scene, tmp_path):
    image = tiled(tmp_path)
    (tmp_path / "a.1002.png").unlink()
    cards = Cards(scene)
    for shift in (0.0, 1.0):
        tree, output = cards.add(f"{shift}")
        texture = node(tree, "ShaderNodeTexImage", {"Vector": shifted(tree, (shift, 0.0, 0.0))}, image=image)
        cards.show(tree, output, texture.outputs["Color"])
    means, warnings = cards.means(tmp_path, samples=64)
    assert differences(means, tolerance=0.03) == {}
    assert len(warnings) == 1 and "tile 1002" in warnings[0]


def test_tiles_that_no_file_holds_have_their_colour(scene, tmp_path):
    image = bpy.data.images.new("Made", 8, 8, tiled=True)
    image.tiles.new(1002)
    for number, color in enumerate([(0.2, 0.5, 0.9, 1.0), (0.6, 0.1, 0.3, 1.0)]):
        image.tiles.active_index = number
        with bpy.context.temp_override(edit_image=image):
            bpy.ops.image.tile_fill(color=color, width=4, height=4)
    cards = Cards(scene)
    for shift in (0.0, 1.0):
        tree, output = cards.add(f"{shift}")
        texture = node(tree, "ShaderNodeTexImage", {"Vector": shifted(tree, (shift, 0.0, 0.0))}, image=image)
        cards.show(tree, output, texture.outputs["Color"])
    means, warnings = cards.means(tmp_path)
    assert differences(means) == {}
    # In older Blenders Cycles looks for their files.
    assert len(warnings) == (0 if "is_generated_tile" in bpy.types.UDIMTile.bl_rna.properties else 2)


def test_unsaved_paint_on_tiles_is_said(scene, tmp_path):
    image = tiled(tmp_path)
    image.pixels[0] = 0.123
    cards = Cards(scene)
    tree, output = cards.add("painted")
    cards.show(tree, output, node(tree, "ShaderNodeTexImage", image=image).outputs["Color"])
    assert ["unsaved paint" in warning for warning in load_scene(scene).warnings] == [True]


@pytest.fixture
def picture(tmp_path):
    """A picture without symmetry."""
    save(tmp_path / "picture.png", np.random.default_rng(2).random((8, 8, 4)) * [1, 1, 1, 0] + [0, 0, 0, 1])
    return bpy.data.images.load(str(tmp_path / "picture.png"))


TURNS = ((0, 0, 0), (1.2, 0.3, 0.4), (0.9, -0.8, 0), (3.6, 0.3, 2.0), (0.95, 0.78, 0.3))


@pytest.mark.parametrize("projection", ["BOX", "SPHERE", "TUBE"])
def test_projections_are_those_of_cycles(scene, tmp_path, picture, projection):
    """Cards whose mesh is turned in its object, seen from the front and the back."""
    cards = Cards(scene, columns=5)
    for blend in (0.0, 0.3, 1.0)[: 3 if projection == "BOX" else 1]:
        for turn in TURNS:
            name = f"{blend} {turn}"
            tree, output = cards.add(name)
            card = scene.objects[name]
            card.data.transform(rotation(turn))
            card.rotation_euler = rotation(turn).inverted().to_euler()
            coordinates = tree.nodes.new("ShaderNodeTexCoord")
            moved = node(
                tree,
                "ShaderNodeMapping",
                {"Vector": coordinates.outputs["Object"], "Location": (0.3, 0.4, 0.2), "Scale": (0.8, 0.7, 0.6)},
            )
            texture = node(tree, "ShaderNodeTexImage", {"Vector": moved.outputs[0]}, image=picture)
            texture.projection, texture.projection_blend = projection, blend
            cards.show(tree, output, texture.outputs["Color"])
    means, warnings = cards.means(tmp_path, samples=256)
    assert differences(means, tolerance=0.04) == {}
    assert warnings == []


def rotation(angles):
    """Matrix of a turn."""
    return Euler(angles).to_matrix().to_4x4()


def test_box_projection_of_an_image_with_tiles(scene, tmp_path):
    image = tiled(tmp_path)
    cards = Cards(scene)
    for shift in (0.0, 1.0):
        tree, output = cards.add(f"{shift}")
        texture = node(tree, "ShaderNodeTexImage", {"Vector": shifted(tree, (0.0, shift, 0.0))}, image=image)
        texture.projection = "BOX"
        cards.show(tree, output, texture.outputs["Color"])
    assert differences(cards.means(tmp_path, samples=128)[0], tolerance=0.03) == {}


def test_coordinates_of_another_object_are_those_of_cycles(scene, tmp_path, picture):
    other = bpy.data.objects.new("Other", None)
    scene.collection.objects.link(other)
    other.location, other.rotation_euler, other.scale = (0.4, 0.2, 0.7), (0.5, 0.3, 0.2), (0.5, 1.5, 0.7)
    cards = Cards(scene)
    for name in ("other", "own"):
        tree, output = cards.add(name)
        coordinates = node(tree, "ShaderNodeTexCoord", object=other if name == "other" else None)
        texture = node(tree, "ShaderNodeTexImage", {"Vector": coordinates.outputs["Object"]}, image=picture)
        cards.show(tree, output, texture.outputs["Color"])
    means, warnings = cards.means(tmp_path, samples=128)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


@pytest.mark.parametrize("kind", ["ShaderNodeTexImage", "ShaderNodeTexEnvironment"])
def test_worlds_show_tiles_as_cycles_does(scene, tmp_path, kind, monkeypatch):
    """Environment textures show none of them, there."""
    monkeypatch.setattr(worlds, "WIDTH", 256)
    background = add_world(scene, strength=1.0)
    tree = scene.world.node_tree
    generated = node(tree, "ShaderNodeTexCoord").outputs["Generated"]
    vector = node(tree, "ShaderNodeMapping", {"Vector": generated, "Location": (1.0, 1.0, 0.0)}).outputs[0]
    texture = node(tree, kind, {"Vector": vector}, image=tiled(tmp_path))
    tree.links.new(texture.outputs["Color"], background.inputs["Color"])
    add_quad(scene, size=0.01)
    camera, render = scene.camera, scene.render
    camera.location, camera.rotation_euler = (0.0, 0.0, 1.0), (math.pi / 2, 0.0, 0.5)
    render.resolution_x, render.resolution_y = 24, 12
    ours, cycles = both_lit(scene, tmp_path / "bake", 64)
    ours, cycles = (image.reshape(2, 6, 4, 6, 3).mean(axis=(1, 3)) for image in (ours, cycles))
    assert np.abs(ours - cycles).max() < 0.05
