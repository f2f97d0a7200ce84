"""Worlds of any nodes become textures that Cycles renders in another Blender."""

import json
import sys
import time

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.engine.workers import process
from addon.engine.world import worlds
from addon.export import trace_settings
from addon.export.materials.graph import resolve
from addon.export.stop import ExportCancelled
from addon.export.world_graph import WorldGraph, WorldReader
from helpers import add, add_material, add_quad, add_world, exported, render_cycles

pytestmark = pytest.mark.oldest_and_newest

COLUMNS, ROWS = 32, 16
WIDTH = 512
"""Width of small textures."""


@pytest.fixture(autouse=True)
def nothing_kept():
    """No texture of another test is used again."""
    worlds.forget()


@pytest.fixture
def world(scene):
    """The Background node of a world, and its tree."""
    background = add_world(scene, strength=1.0)
    add_quad(scene)
    return background, scene.world.node_tree


@pytest.fixture
def small(monkeypatch):
    """Textures of fewer columns."""
    monkeypatch.setattr(worlds, "WIDTH", WIDTH)


@pytest.fixture
def fake(monkeypatch):
    """Jobs that would have been rendered, in place of rendering them."""
    rendered = []

    def render(job, _contents, _stop):
        rendered.append(job)
        return np.full((2, 4, 4), len(rendered), np.float32)

    monkeypatch.setattr(worlds, "_render", render)
    return rendered


def painted(name="Painted"):
    """An image of random colours that is in no file."""
    image = bpy.data.images.new(name, COLUMNS, ROWS, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"  # Otherwise saving would encode them.
    pixels = np.random.default_rng(1).random((ROWS, COLUMNS, 4), np.float32)
    pixels[..., 3] = 1.0
    image.pixels.foreach_set(pixels.reshape(-1))
    return image, pixels


def nodes(tree, *kinds):
    """New shader nodes."""
    return [tree.nodes.new(f"ShaderNode{kind}") for kind in kinds]


def sky(tree, background, **settings):
    """A sky that feeds the colour."""
    (node,) = nodes(tree, "TexSky")
    for name, value in settings.items():
        setattr(node, name, value)
    tree.links.new(node.outputs[0], background.inputs["Color"])
    return node


def refined(image, factor):
    """An environment texture at `factor` times its resolution, as rendering interpolates it between texels."""
    rows, columns = ((np.arange(count * factor) + 0.5) / factor - 0.5 for count in (image.shape[0], image.shape[1]))
    y, x = np.floor(rows).astype(int), np.floor(columns).astype(int)
    v, u = (rows - y)[:, None, None], (columns - x)[None, :, None]

    def texel(dy, dx):
        return image[(y + dy) % image.shape[0]][:, (x + dx) % image.shape[1]]

    lower, upper = (texel(dy, 0) * (1 - u) + texel(dy, 1) * u for dy in (0, 1))
    return lower * (1 - v) + upper * v


def opened(image, file):
    """The image from a file that it is written to."""
    image.file_format, image.filepath_raw = "OPEN_EXR", str(file)
    image.save()
    found = bpy.data.images.load(str(file))
    found.colorspace_settings.name = "Non-Color"
    return found


@pytest.mark.parametrize("lies", ["in memory", "in a file", "packed"])
def test_a_rendered_texture_lies_as_the_environment_texture_does(scene, world, small, tmp_path, lies):
    background, tree = world
    image, pixels = painted()
    if lies != "in memory":
        image = opened(image, tmp_path / "sky.exr")
    if lies == "packed":
        image.pack()
        (tmp_path / "sky.exr").unlink()
    texture, gamma = nodes(tree, "TexEnvironment", "Gamma")
    texture.image = image
    gamma.inputs["Gamma"].default_value = 2.0
    tree.links.new(texture.outputs[0], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], background.inputs["Color"])
    loaded = load_scene(scene)
    assert loaded.warnings == []
    found = loaded.texels(0)
    assert found.shape == (WIDTH // 2, WIDTH, 4)
    wanted = refined(pixels, WIDTH // COLUMNS)[..., :3] ** 2
    difference = np.abs(found[..., :3] - wanted)[1:-1]  # A rounding reaches over the poles.
    assert difference.max() < 0.03 and difference.mean() < 0.003


def test_a_sky_with_its_sun_lights_as_in_cycles(scene, tmp_path):
    scene.world = None
    background = add_world(scene, strength=0.1)
    material, tree, output = add_material("White")
    (diffuse,) = nodes(tree, "BsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=20.0, material=material)
    sky(scene.world.node_tree, background, sun_elevation=0.6, sun_rotation=0.7)
    scene.render.resolution_x, scene.render.resolution_y = 16, 12
    settings = trace_settings(scene, lambda _: None) | {"samples": 512}
    relume.bake(load_scene(scene), tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(denoise=False)["combined"].mean(axis=(0, 1))
    assert ours / render_cycles(scene, samples=128).mean(axis=(0, 1)) == pytest.approx(1.0, abs=0.01)


def test_nodes_of_every_kind_give_what_cycles_shows(scene, small, tmp_path):
    """A group with a ramp, curves, an object that moves and turns, and a texture mapping."""
    background = add_world(scene, strength=1.5)
    add_quad(scene, size=0.01)
    tree = scene.world.node_tree
    empty = add(scene, "Place", None)
    empty.location, empty.rotation_euler, empty.scale = (0.2, 0.1, 0.3), (0.3, 0.2, 0.9), (1.0, 2.0, 1.0)
    group = bpy.data.node_groups.new("Look", "ShaderNodeTree")
    for name, way in (("In", "INPUT"), ("Out", "OUTPUT")):
        group.interface.new_socket(name, in_out=way, socket_type="NodeSocketColor")
    begin, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    curves, saturation = nodes(group, "RGBCurve", "HueSaturation")
    curves.mapping.curves[0].points.new(0.3, 0.7)
    curves.mapping.update()
    saturation.inputs["Hue"].default_value = 0.7
    group.links.new(begin.outputs[0], curves.inputs["Color"])
    group.links.new(curves.outputs[0], saturation.inputs["Color"])
    group.links.new(saturation.outputs[0], end.inputs[0])
    coordinates, texture, ramp, gradient, mix, user = nodes(
        tree, "TexCoord", "TexEnvironment", "ValToRGB", "TexGradient", "MixRGB", "Group"
    )
    coordinates.object, texture.image, user.node_tree = empty, painted()[0], group
    gradient.texture_mapping.rotation = (0.5, 0.3, 0.1)
    ramp.color_ramp.elements.new(0.4).color = (1.0, 0.2, 0.1, 1.0)
    mix.blend_type = "ADD"
    tree.links.new(coordinates.outputs["Object"], texture.inputs["Vector"])
    tree.links.new(gradient.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(texture.outputs[0], mix.inputs[1])
    tree.links.new(ramp.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], user.inputs[0])
    tree.links.new(user.outputs[0], background.inputs["Color"])
    scene.camera.rotation_euler, scene.camera.data.lens = (1.9, 0.2, 0.3), 10.0
    loaded = load_scene(scene)
    assert loaded.warnings == []
    settings = trace_settings(scene, lambda _: None) | {"samples": 128}
    relume.bake(loaded, tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(denoise=False)["combined"]
    cycles = render_cycles(scene, samples=128)[::-1]
    assert cycles.std() > 0.1
    assert np.abs(ours - cycles).mean() < 0.01 * cycles.mean()


def test_a_world_in_another_working_space_keeps_its_numbers(scene, world, small):
    if not hasattr(bpy.data, "colorspace"):
        pytest.skip("files have no working space before Blender 5.0")
    bpy.ops.wm.set_working_color_space(working_space="Linear Rec.2020")
    background, tree = world
    (gradient,) = nodes(tree, "TexGradient")
    (scale,) = nodes(tree, "VectorMath")
    scale.operation, scale.inputs[1].default_value = "MULTIPLY", (0.0, 0.0, 0.0)
    (shift,) = nodes(tree, "VectorMath")
    shift.inputs[1].default_value = (0.9, 0.2, 0.1)
    tree.links.new(gradient.outputs[0], scale.inputs[0])
    tree.links.new(scale.outputs[0], shift.inputs[0])
    tree.links.new(shift.outputs[0], background.inputs["Color"])
    assert load_scene(scene).texels(0)[0, 0, :3] == pytest.approx([0.9, 0.2, 0.1], abs=1e-4)


def test_the_strength_is_a_factor_and_renders_nothing_anew(scene, world, fake):
    background, tree = world
    sky(tree, background, sun_elevation=0.5)
    before = exported(scene)["world"]
    background.inputs["Strength"].default_value = 3.0
    after = exported(scene)["world"]
    assert len(fake) == 1 and before["color"] == [1, 1, 1] and after["color"] == [3, 3, 3]
    tree.nodes["Sky Texture"].sun_elevation = 0.6
    exported(scene)
    tree.nodes["Sky Texture"].sun_elevation = 0.5
    exported(scene)
    assert len(fake) == 2


def test_a_world_is_rendered_for_each_kind_of_ray_that_sees_another(scene, world, fake):
    background, tree = world
    node = sky(tree, background)
    path, gamma = nodes(tree, "LightPath", "Gamma")
    tree.links.new(node.outputs[0], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], background.inputs["Color"])
    tree.links.new(path.outputs["Is Camera Ray"], gamma.inputs["Gamma"])
    assert exported(scene)["warnings"] == [] and len(fake) == 2
    gammas = [node["inputs"]["Gamma"] for job in fake for node in json.loads(job)["nodes"] if "Gamma" in node["type"]]
    assert sorted(gammas) == [0.0, 1.0]
    tree.links.new(path.outputs["Is Glossy Ray"], gamma.inputs["Gamma"])
    assert any("depends on Light Path" in text for text in exported(scene)["warnings"])


def test_an_animated_world_is_that_of_its_frame(scene, world, fake):
    background, tree = world
    node = sky(tree, background)
    for frame, elevation in ((1, 0.1), (11, 0.6)):
        node.sun_elevation = elevation
        node.keyframe_insert("sun_elevation", frame=frame)
    hashes = []
    for frame in (1, 6, 1):
        scene.frame_set(frame)
        hashes.append(load_scene(scene).world_map)
    assert len(fake) == 2 and hashes[0] == hashes[2] != hashes[1]


@pytest.mark.parametrize("how", ["painted", "packed", "written"])
def test_other_pixels_are_rendered_anew(scene, world, fake, tmp_path, how):
    background, tree = world
    image, _ = painted()
    image.file_format, image.filepath_raw = "OPEN_EXR", str(tmp_path / "sky.exr")
    if how != "painted":
        image.save()
    texture, gamma = nodes(tree, "TexEnvironment", "Gamma")
    texture.image = image
    tree.links.new(texture.outputs[0], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], background.inputs["Color"])
    exported(scene)
    exported(scene)
    assert len(fake) == 1
    image.pixels[0] = 7.0
    if how == "packed":
        image.pack()
    elif how == "written":
        image.save()
    exported(scene)
    assert len(fake) == 2


def test_what_cannot_be_rendered_is_named(scene, world, fake):
    background, tree = world
    (coordinates,) = nodes(tree, "TexCoord")
    tree.links.new(coordinates.outputs["Window"], background.inputs["Color"])
    out = exported(scene)
    assert out["world"]["color"] == [0, 0, 0] and fake == []
    assert any("node 'Texture Coordinate' (Window) depends on the camera" in text for text in out["warnings"])


def test_a_missing_picture_is_named(scene, world, tmp_path):
    background, tree = world
    texture, gamma = nodes(tree, "TexEnvironment", "Gamma")
    texture.image = opened(painted()[0], tmp_path / "sky.exr")
    (tmp_path / "sky.exr").unlink()
    tree.links.new(texture.outputs[0], gamma.inputs["Color"])
    tree.links.new(gamma.outputs[0], background.inputs["Color"])
    assert any("image 'sky.exr' could not be read" in text for text in exported(scene)["warnings"])


def other_program(monkeypatch, code):
    """Runs this in place of another Blender."""
    monkeypatch.setattr(process, "blender_command", lambda _blend, _arguments: [sys.executable, "-c", code])


def test_a_failure_of_the_other_blender_is_told_once(scene, world, monkeypatch):
    background, tree = world
    sky(tree, background)
    other_program(monkeypatch, "raise SystemExit('Error: out of memory')")
    out = exported(scene)
    assert out["world"]["color"] == [0, 0, 0]
    assert out["warnings"] == ["world 'Sky': Cycles could not render it: Error: out of memory; the world is black"]


def test_rendering_can_be_cancelled(scene, world, monkeypatch):
    background, tree = world
    sky(tree, background)
    other_program(monkeypatch, "import time; time.sleep(60)")
    started, workers = time.monotonic(), []
    worker = process.Worker
    monkeypatch.setattr(process, "Worker", lambda *asked: workers.append(worker(*asked)) or workers[-1])
    graph = WorldGraph(resolve(tree.get_output_node("CYCLES").inputs["Surface"], ()), WorldReader())
    with pytest.raises(ExportCancelled):
        worlds.rendered(graph, None, lambda: time.monotonic() > started + 0.2)
    assert time.monotonic() < started + 10.0 and workers[0].code is not None
