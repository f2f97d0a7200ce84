"""Another HDRI, or one that was turned, is shown without new paths, by the real native module."""

import json
import math
import os
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import relume

from addon.core import status
from addon.core.solve import SolveError
from addon.engine.reading.scene import load_scene
from addon.engine.shot import record, shot
from addon.engine.world import world_change, worlds
from addon.ui.solve import operators
from addon.ui.start import open_bake, start
from helpers import add_sky, add_world, settled, sky_file, until, update


@pytest.fixture
def turnable(studio, tmp_path):
    """A bake under a sky, and the Mapping node that turns it."""
    _, mapping = add_sky(add_world(studio, strength=2.0), sky_file(tmp_path))
    update()
    start(studio)
    picture(studio, "the first picture")
    return studio, mapping


def picture(scene, what):
    """The settled picture of the present world, and that nothing is to be baked again."""

    def is_there(found):
        return settled(found) and not found.changes.is_pending and found.present_frame is not None

    found = until(scene, is_there, what)
    assert found.changes.sentences == []
    return found.frame.image[..., :3].copy()


def turn(mapping, angle):
    """Turns the sky, as the artist does."""
    mapping.inputs["Rotation"].default_value.z = angle
    update()


def shards(folder):
    """When each shard of a bake was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.safetensors")}


def test_another_background_for_some_rays_is_shown_without_new_paths(turnable, tmp_path):
    scene, mapping = turnable
    before, paths = picture(scene, "the first picture"), shards(tmp_path / "bake")
    tree = mapping.id_data
    surface = tree.get_output_node("CYCLES").inputs["Surface"]
    other, path, mix = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Background", "LightPath", "MixShader"))
    other.inputs["Color"].default_value = (0.0, 5.0, 0.0, 1.0)
    sources = (path.outputs["Is Diffuse Ray"], surface.links[0].from_socket, other.outputs[0], mix.outputs[0])
    for source, target in zip(sources, (*mix.inputs[:3], surface), strict=True):
        tree.links.new(source, target)
    update()
    shown = picture(scene, "the other background")
    assert np.abs(shown - before).max() > 0.1 and shards(tmp_path / "bake") == paths
    relume.bake(exported := load_scene(scene), tmp_path / "other", {"samples": 64, "seed": 5}).wait()
    expected = relume.Relighter(tmp_path / "other").relight()["combined"][::-1]
    assert np.abs(shown.mean(axis=(0, 1)) - expected.mean(axis=(0, 1))).max() < 0.1 * expected.mean()
    assert shot.of(scene).status.live.world_map == exported.world_map
    other.inputs["Strength"].default_value = 2.0
    update()
    assert picture(scene, "a brighter one").sum() > shown.sum()


def test_a_turned_sky_is_shown_without_new_paths_and_found_again(turnable, tmp_path):
    scene, mapping = turnable
    before, paths = picture(scene, "the first picture"), shards(tmp_path / "bake")
    turn(mapping, math.pi)
    assert shot.of(scene).present_frame is None, "the old world passes for the present one"
    turned = picture(scene, "the turned sky")
    assert np.abs(turned - before).max() > 0.1 and shards(tmp_path / "bake") == paths

    exported, other = load_scene(scene), tmp_path / "other"
    relume.bake(exported, other, {"samples": 64, "seed": 5}).wait()
    expected = relume.Relighter(other).relight()["combined"][::-1]
    assert np.abs(turned.mean(axis=(0, 1)) - expected.mean(axis=(0, 1))).max() < 0.1 * expected.mean()
    assert shot.of(scene).status.live.world_map == exported.world_map

    # A factor on the new world.
    mapping.id_data.nodes["Background"].inputs["Strength"].default_value = 4.0
    update()
    assert picture(scene, "a brighter one").sum() > 1.2 * turned.sum()
    mapping.id_data.nodes["Background"].inputs["Strength"].default_value = 2.0
    update()
    assert np.abs(picture(scene, "as before") - turned).max() < 1e-3 * turned.max()

    until(scene, lambda found: found.status.live.world_is_stored, "the stored light")
    shot.of(scene).close(5.0)
    open_bake(scene)
    assert np.abs(picture(scene, "the opened bake") - turned).max() < 1e-3 * turned.max()
    assert not shot.of(scene).is_changing_world
    turn(mapping, 0.0)
    assert np.abs(picture(scene, "the old sky") - before).max() < 1e-3 * before.max()
    assert shards(tmp_path / "bake") == paths and not (tmp_path / "bake" / "world.exr").exists()


def test_a_file_is_read_once_however_often_its_sky_is_turned(turnable, tmp_path, monkeypatch):
    scene, mapping = turnable
    read = []

    class Builder:
        constant_emission = staticmethod(relume.SceneBuilder.constant_emission)

        def __init__(self, *arguments):
            self._builder = relume.SceneBuilder(*arguments)

        def __getattr__(self, name):
            return getattr(self._builder, name)

        def add_texture_file(self, name, *arguments, **more):
            read.append(name)
            return self._builder.add_texture_file(name, *arguments, **more)

    monkeypatch.setattr(world_change, "native", lambda: SimpleNamespace(SceneBuilder=Builder))
    turn(mapping, 1.0)
    picture(scene, "the turned sky")
    turn(mapping, math.pi)
    turned = picture(scene, "one that was turned more")
    assert read == ["sky.png"]
    assert shot.of(scene).status.live.world_map == load_scene(scene).world_map
    file = sky_file(tmp_path)
    os.utime(file, ns=(1, 1))
    turn(mapping, 3.0)
    picture(scene, "a file that was written anew")
    assert read == ["sky.png"] * 2
    turn(mapping, math.pi)
    assert np.abs(picture(scene, "as before") - turned).max() < 1e-3 * turned.max()


def test_a_stopped_bake_says_that_going_on_under_another_world_traces_anew(studio, tmp_path):
    _, mapping = add_sky(add_world(studio), sky_file(tmp_path))
    studio.relume.samples = 4096
    update()
    start(studio)
    until(studio, lambda found: found.status.live.samples > 0, "samples").cancel()
    found = until(studio, lambda found: found.status.phase == "cancelled" and settled(found), "the end")
    assert status.headline(found.status).endswith("they are kept")
    turn(mapping, 2.0)
    picture(studio, "the turned sky")
    assert "Resume traces them anew" in status.headline(found.status)
    turn(mapping, 0.0)
    picture(studio, "the old sky")
    assert status.headline(found.status).endswith("they are kept")
    before = json.loads((tmp_path / "bake" / "manifest.json").read_text())["world_map"]
    turn(mapping, 2.0)
    picture(studio, "the turned sky")
    assert bpy.ops.relume.go_on() == {"FINISHED"}
    found = until(studio, lambda found: found.status.live.samples > 0, "new samples")
    after = json.loads((tmp_path / "bake" / "manifest.json").read_text())["world_map"]
    assert after != before and not found.status.is_under_another_world


def test_other_images_and_plain_colours_take_turns(turnable):
    scene, mapping = turnable
    before = picture(scene, "the first picture")
    tree = mapping.id_data
    texture = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeTexEnvironment")
    image, texture.image = texture.image, bpy.data.images.new("Green", 4, 2)
    texture.image.pixels.foreach_set([0.0, 1.0, 0.0, 1.0] * 8)
    update()
    green = picture(scene, "a painted sky")
    assert green[..., 1].sum() > 1.5 * before[..., 1].sum()
    background, link = tree.nodes["Background"], texture.outputs[0].links[0]
    tree.links.remove(link)
    background.inputs["Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    update()
    red = picture(scene, "a red world")
    assert red[..., 1].sum() < 0.9 * green[..., 1].sum()
    visibility = scene.world.cycles_visibility
    visibility.camera = False
    scene.world.update_tag()
    update()
    picture(scene, "a world that the camera does not see")
    visibility.camera = True
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    texture.image = image
    update()
    assert np.abs(picture(scene, "the old sky") - before).max() < 1e-3 * before.max()


def test_a_rebake_is_of_the_present_world(turnable, tmp_path):
    scene, mapping = turnable
    paths = shards(tmp_path / "bake")
    turn(mapping, 2.0)
    picture(scene, "the turned sky")
    assert start(scene) is shot.of(scene)
    picture(scene, "the same paths")
    manifest = json.loads((tmp_path / "bake" / "manifest.json").read_text())
    assert shards(tmp_path / "bake") == paths and manifest["world_map"] != load_scene(scene).world_map
    assert bpy.ops.relume.rebake() == {"FINISHED"}
    picture(scene, "new paths")
    manifest = json.loads((tmp_path / "bake" / "manifest.json").read_text())
    assert manifest["world_map"] == load_scene(scene).world_map
    assert list(record.read(tmp_path / "bake").maps) == [manifest["world_map"]]


def test_a_world_that_cannot_be_read_is_named_and_nothing_is_solved(turnable, monkeypatch):
    scene, mapping = turnable
    monkeypatch.setattr(worlds, "_render", lambda *_arguments: (_ for _ in ()).throw(OSError("no room")))
    tree = mapping.id_data
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = "HOSEK_WILKIE"
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    update()
    with pytest.raises(SolveError, match="The world has changed"):
        operators.begin(scene)
    found = until(scene, lambda found: found.changes.sentences, "what went wrong")
    reason = "Cycles could not render it: no room"
    assert found.changes.sentences == [f"The world changed, and its light could not be gathered: {reason}"]
