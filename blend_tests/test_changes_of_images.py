"""Image files, and the pictures of sequences, that have changed since the bake are noticed."""

import bpy
import pytest

from addon.engine.shot import shot
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add_material, add_quad, background, said


def write_image(path, color):
    """A picture file as an artist's other program would write it."""
    image = bpy.data.images.new("made elsewhere", 4, 4)
    image.pixels.foreach_set([*color, 1.0] * 16)
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    bpy.data.images.remove(image)


@pytest.fixture
def textured(lit, tmp_path):
    """A bake of a quad with an image file in a group of its material, and of a world with another."""
    for name in ("wood.png", "sky.png"):
        write_image(tmp_path / name, (0.5, 0.5, 0.5))
    lit.world = bpy.data.worlds.new("World")
    if bpy.app.version < (5, 2, 0):
        lit.world.use_nodes = True
    sky = lit.world.node_tree.nodes.new("ShaderNodeTexEnvironment")
    sky.image = bpy.data.images.load(str(tmp_path / "sky.png"))
    lit.world.node_tree.links.new(sky.outputs["Color"], background(lit).inputs["Color"])
    material, tree, output = add_material("Floor")
    group = bpy.data.node_groups.new("Wood", "ShaderNodeTree")
    group.interface.new_socket("Color", in_out="OUTPUT", socket_type="NodeSocketColor")
    wood = group.nodes.new("ShaderNodeTexImage")
    wood.image = bpy.data.images.load(str(tmp_path / "wood.png"))
    group.links.new(wood.outputs["Color"], group.nodes.new("NodeGroupOutput").inputs["Color"])
    user, diffuse = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeBsdfDiffuse")
    user.node_tree = group
    tree.links.new(user.outputs["Color"], diffuse.inputs["Color"])
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(lit, "Floor", material=material)
    bpy.context.view_layer.update()
    start(lit)
    FakeLive.made[-1].tell(state="ready", samples=4, samples_total=4)
    assert said(lit) == []
    return lit


@pytest.mark.parametrize("name", ["wood.png", "sky.png"])
def test_image_files_that_change_on_disk_are_named(textured, tmp_path, name):
    write_image(tmp_path / name, (1.0, 0.0, 0.0))
    assert scheduler.look_at_files()
    assert said(textured) == [f"The file of image '{name}' changed"]
    (tmp_path / name).unlink()
    scheduler.look_at_files()
    assert said(textured) == [f"The file of image '{name}' changed"]


def test_a_rebake_reads_changed_image_files_anew(textured, tmp_path):
    image = bpy.data.images["wood.png"]
    assert image.pixels[0] == pytest.approx(0.5, abs=0.01)
    write_image(tmp_path / "wood.png", (1.0, 0.0, 0.0))
    scheduler.look_at_files()
    assert len(said(textured)) == 1
    start(textured)
    assert tuple(image.pixels[:3]) == (1.0, 0.0, 0.0)
    assert said(textured) == []


def test_painted_pixels_outlive_a_rebake(textured, tmp_path):
    image = bpy.data.images["wood.png"]
    image.pixels.foreach_set([0.0, 1.0, 0.0, 1.0] * 16)
    write_image(tmp_path / "wood.png", (1.0, 0.0, 0.0))
    scheduler.look_at_files()
    assert len(said(textured)) == 1
    start(textured)
    assert tuple(image.pixels[:3]) == (0.0, 1.0, 0.0)


def test_bakes_from_before_image_files_were_noted_say_nothing_of_them(textured):
    found = shot.of(textured).changes
    for key in [key for key in found.baked if key.startswith("image ")]:
        del found.baked[key]
    found.mark_all()
    assert said(textured) == []


def test_another_picture_of_a_sequence_is_named(lit, tmp_path):
    for number in (1, 2, 3):
        write_image(tmp_path / f"film_{number:03}.png", (0.2 * number, 0.5, 0.5))
    image = bpy.data.images.load(str(tmp_path / "film_001.png"))
    image.source = "SEQUENCE"
    material, tree, output = add_material("Screen")
    texture, emission = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexImage", "Emission"))
    texture.image, texture.image_user.frame_duration = image, 2
    tree.links.new(texture.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(lit, "Wall", material=material)
    bpy.context.view_layer.update()
    start(lit)
    assert said(lit) == []
    words = [f"Image '{image.name}' shows another picture in this frame"]
    lit.frame_set(2)
    assert said(lit) == words
    lit.frame_set(1)
    assert said(lit) == []
    texture.image_user.frame_offset = 1
    assert said(lit) == words
    texture.image_user.frame_offset = 0
    assert said(lit) == []
    write_image(tmp_path / "film_002.png", (0.0, 0.0, 0.0))
    scheduler.look_at_files()
    assert said(lit) == []


def show(scene, kind, output="Color", **settings):
    """A baked wall whose material shows an output of a node; returns the wall and the node."""
    material, tree, surface = add_material("Screen")
    node, emission = tree.nodes.new(kind), tree.nodes.new("ShaderNodeEmission")
    for name, value in settings.items():
        setattr(node, name, value)
    tree.links.new(node.outputs[output], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], surface.inputs["Surface"])
    wall = add_quad(scene, "Wall", material=material)
    return wall, node


def test_tiles_that_change_or_come_are_named(lit, tmp_path):
    for number in (1001, 1002):
        write_image(tmp_path / f"a.{number}.png", (0.1 * (number - 1000), 0.5, 0.5))
    image = bpy.data.images.load(str(tmp_path / "a.1001.png"))
    image.source, image.filepath = "TILED", str(tmp_path / "a.<UDIM>.png")
    show(lit, "ShaderNodeTexImage", image=image)
    bpy.context.view_layer.update()
    start(lit)
    assert said(lit) == []
    words = [f"The file of image '{image.name}' changed"]
    write_image(tmp_path / "a.1002.png", (0.9, 0.9, 0.9))
    scheduler.look_at_files()
    assert said(lit) == words
    start(lit)
    assert said(lit) == []
    write_image(tmp_path / "a.1003.png", (0.1, 0.2, 0.3))
    image.tiles.new(1003)
    shot.of(lit).changes.mark_all()
    assert said(lit) == words


def test_an_object_that_gives_coordinates_is_watched(lit):
    other = bpy.data.objects.new("Other", None)
    lit.collection.objects.link(other)
    show(lit, "ShaderNodeTexCoord", "Object", object=other)
    bpy.context.view_layer.update()
    start(lit)
    assert said(lit) == []
    other.location.x = 1.0
    bpy.context.view_layer.update()
    assert said(lit) == ["'Other' moved"]


def test_custom_properties_that_materials_ask_for_are_watched(lit):
    wall, _ = show(lit, "ShaderNodeAttribute", attribute_type="OBJECT", attribute_name="paint")
    wall["paint"], wall["other"] = 0.2, 0.3
    wall.update_tag()
    bpy.context.view_layer.update()
    start(lit)
    assert said(lit) == []
    for name, words in (("other", []), ("paint", ["Custom properties of 'Wall' changed"])):
        wall[name] = 0.9
        wall.update_tag()
        bpy.context.view_layer.update()
        assert said(lit) == words


def test_properties_of_the_scene_that_materials_ask_for_are_watched(lit):
    show(lit, "ShaderNodeAttribute", attribute_type="VIEW_LAYER", attribute_name="paint")
    lit["paint"] = 0.2
    bpy.context.view_layer.update()
    start(lit)
    assert said(lit) == []
    lit["paint"] = 0.7
    shot.of(lit).changes.mark_all()
    assert said(lit) == ["Material 'Screen' changed"]
