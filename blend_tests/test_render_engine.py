"""Relume as a render engine: F12, its passes and what goes wrong."""

import json
import math
import os
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import relume

import addon
from addon.commands import run
from addon.core.pass_names import light_passes
from addon.engine.reading.scene import load_scene
from addon.engine.render import render_engine
from addon.engine.render.render_engine import ALBEDO_HERE
from addon.engine.shot import background, open_shots
from addon.engine.shot.options import remember_bake
from addon.export.camera import film_border
from addon.live import rows
from addon.ui import render as ui
from addon.viewport import rendered
from exr import read_exr
from helpers import (
    add,
    add_light,
    add_material,
    add_quad,
    add_sky,
    add_world,
    instance_linked_light,
    shear,
    sky_file,
    write_multilayer,
)

pytestmark = pytest.mark.every_version


@pytest.fixture
def shot(scene, tmp_path):
    """A plane under two lights that F12 renders by Relume, small and quick to bake."""
    addon.register()
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=3.0, material=material)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    add_light(scene, "AREA", name="Rim.001", location=(1, 0, 2), size=1.0)
    scene.render.resolution_x, scene.render.resolution_y = 48, 32
    scene.render.engine = "RELUME"
    scene.relume.quality, scene.relume.samples = "CUSTOM", 16
    scene.relume.folder = str(tmp_path / "bake")
    write_multilayer(scene, tmp_path / "f12.exr")
    yield scene
    addon.unregister()


def render(scene, tmp_path):
    """Passes of F12."""
    bpy.ops.render.render(write_still=True)
    return passes_of(tmp_path / "f12.exr")


def passes_of(path, composite=False):
    """Passes of a file by name, or what the compositor has made, [height, width, channels], top row first."""
    passes = {}
    for name, channel in read_exr(path).items():
        layer, name, letter = name.split(".")
        if (layer == "Composite") == composite:
            passes.setdefault(name, {})[letter] = channel
    return {
        name: np.stack([found[letter] for letter in "RGBAXYZ" if letter in found], axis=-1)
        for name, found in passes.items()
    }


def shards(folder):
    """When each shard of a bake was written."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.safetensors")}


def relit(scene, tmp_path, lights=None):
    """Pictures that `relume relight` computes for lights, by default those of the open file."""
    return relume.Relighter(tmp_path / "bake").relight(lights or load_scene(scene).lights())


def test_a_render_is_what_relight_makes_of_the_present_lights(shot, tmp_path):
    first = render(shot, tmp_path)
    bake = shards(tmp_path / "bake")
    assert bake
    bpy.data.lights["Key"].energy *= 2.0
    second, expected = render(shot, tmp_path), relit(shot, tmp_path)
    assert bake == shards(tmp_path / "bake")
    assert (second["Combined"][..., :3] == expected["combined"]).all()
    assert (second["Combined"][..., 3:] == expected["alpha"]).all()
    assert (second["Combined_Key"] == expected["lights"]["Key"]).all()
    assert (second["Combined_Rim_001"] == expected["lights"]["Rim.001"]).all()
    assert second["Combined_Key"] == pytest.approx(2.0 * first["Combined_Key"], rel=1e-5)


def test_a_render_is_the_file_of_the_command_line(shot, tmp_path):
    ours = render(shot, tmp_path)
    out = tmp_path / "relit.exr"
    assert run(["relight", str(tmp_path / "bake"), "--out", str(out), "--quiet", "--float"]) == 0
    file = passes_of(out)
    for name, image in ours.items():
        assert (image == file[name]).all(), name


def test_the_rows_are_in_the_render(shot, tmp_path):
    plain = render(shot, tmp_path)
    rows.sync(shot)
    for row in rows.present_rows(shot):
        if row.name == "Key":
            row.exposure = 1.0
        if row.name == "Rim.001":
            row.on = False
    mixed = render(shot, tmp_path)
    assert mixed["Combined_Key"] == pytest.approx(2.0 * plain["Combined_Key"], rel=1e-6)
    assert (mixed["Combined_Rim_001"] == 0.0).all()
    assert mixed["Combined"][..., :3] == pytest.approx(mixed["Combined_Key"], rel=1e-6)


def test_a_brighter_world_needs_no_new_bake(shot, tmp_path):
    background = add_world(shot, color=(0.2, 0.4, 0.4), strength=0.5)
    first, bake = render(shot, tmp_path), shards(tmp_path / "bake")
    background.inputs["Strength"].default_value = 1.5
    background.inputs["Color"].default_value = (0.2, 0.2, 0.4, 1.0)
    second = render(shot, tmp_path)
    assert shards(tmp_path / "bake") == bake
    assert first["world"].mean() > 0.01
    assert second["world"] == pytest.approx(first["world"] * [3.0, 1.5, 3.0], rel=1e-5)
    total = sum(second[name] for name in ("static", "world", "Combined_Key", "Combined_Rim_001"))
    assert second["Combined"][..., :3] == pytest.approx(total, rel=1e-5)


def test_another_world_needs_no_new_bake(shot, tmp_path):
    texture, mapping = add_sky(add_world(shot, color=(0.2, 0.4, 0.4), strength=2.0), sky_file(tmp_path))
    first, bake = render(shot, tmp_path), shards(tmp_path / "bake")
    mapping.inputs["Rotation"].default_value.z = math.pi
    second = render(shot, tmp_path)
    expected = relume.Relighter(tmp_path / "bake", world_of=load_scene(shot)).relight("[]")
    assert (second["world"] == expected["world"]).all()
    assert np.abs(second["world"] - first["world"]).max() > 0.1
    mapping.inputs["Rotation"].default_value.z = 0.0
    assert (render(shot, tmp_path)["world"] == first["world"]).all()
    texture.image = None
    assert shards(tmp_path / "bake") == bake


def test_the_passes_add_up(shot, tmp_path):
    passes = render(shot, tmp_path)
    lights = ["Combined_Key", "Combined_Rim_001"]
    assert set(passes) == {"Combined", "static", "world", *lights}
    total = sum(passes[name] for name in ("static", *lights, "world"))
    assert passes["Combined"][..., :3] == pytest.approx(total, rel=1e-6)
    shot.relume_render.light_passes = False
    assert set(render(shot, tmp_path)) == {"Combined"}


def test_depth_normal_and_colour_are_those_of_cycles(shot, tmp_path):
    layer = shot.view_layers[0]
    layer.use_pass_z = layer.use_pass_normal = layer.use_pass_diffuse_color = True
    shot.camera.rotation_euler = (0.2, 0.1, 0.3)
    ours = render(shot, tmp_path)
    shot.render.engine, shot.cycles.samples, shot.cycles.pixel_filter_type = "CYCLES", 16, "BOX"
    cycles = render(shot, tmp_path)
    inside = (ours["Depth"][..., 0] < 100) & (cycles["Depth"][..., 0] < 100)
    assert 0.2 < inside.mean() < 0.9
    assert ours["Depth"][inside] == pytest.approx(cycles["Depth"][inside], rel=0.01)
    beyond = (ours["Depth"][..., 0] > 1e9) & (cycles["Depth"][..., 0] > 1e9)
    assert (inside | beyond).mean() > 0.9
    whole = inside & (ours["Combined"][..., 3] == 1.0) & (cycles["Combined"][..., 3] == 1.0)
    assert np.abs(ours["Normal"] - cycles["Normal"])[whole].mean() < 0.02
    assert np.abs(ours[ALBEDO_HERE] - cycles[ALBEDO_HERE])[whole].mean() < 0.02


def test_the_render_border_is_a_part_of_the_picture(shot, tmp_path):
    whole = render(shot, tmp_path)["Combined"]
    settings = shot.render
    settings.use_border = True
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.25, 0.7, 0.1, 0.6
    left, bottom, width, height = film_border(settings)
    assert (left, bottom, width, height) == (12, 3, 21, 16)
    part = whole[32 - bottom - height : 32 - bottom, left : left + width]
    bordered = render(shot, tmp_path)["Combined"]
    assert (bordered[32 - bottom - height : 32 - bottom, left : left + width] == part).all()
    settings.use_crop_to_border = True
    assert (render(shot, tmp_path)["Combined"] == part).all()


def test_another_view_is_baked_for_the_picture_alone(shot, tmp_path):
    first = render(shot, tmp_path)["Combined"]
    manifest = (tmp_path / "bake" / "manifest.json").read_bytes()
    shot.camera.location.x += 0.5
    temporary = os.listdir(bpy.app.tempdir)
    assert (render(shot, tmp_path)["Combined"] != first).any()
    assert (tmp_path / "bake" / "manifest.json").read_bytes() == manifest
    assert os.listdir(bpy.app.tempdir) == temporary
    shot.camera.location.x -= 0.5
    assert (render(shot, tmp_path)["Combined"] == first).all()


def test_other_settings_of_paths_are_baked_for_the_picture_alone(shot, tmp_path):
    first = render(shot, tmp_path)["Combined"]
    manifest = (tmp_path / "bake" / "manifest.json").read_bytes()
    shot.cycles.film_exposure = 2.0
    brighter = render(shot, tmp_path)["Combined"]
    assert brighter[..., :3].mean() == pytest.approx(2.0 * first[..., :3].mean(), rel=0.02)
    assert (tmp_path / "bake" / "manifest.json").read_bytes() == manifest


def test_a_folder_that_is_baked_in_the_background_is_left_alone(shot, tmp_path, monkeypatch):
    job = SimpleNamespace(is_running=True, folder=tmp_path / "bake", scene_uid=0)
    monkeypatch.setattr(background, "_jobs", [job])
    assert render(shot, tmp_path)["Combined"].max() > 0.0
    assert not (tmp_path / "bake").exists()
    job.is_running = False


def test_a_lamp_that_was_moved_out_of_sight_is_traced_for(shot, tmp_path):
    key = shot.objects["Key"]
    shear(shot, key)
    key.data.energy = 300.0
    render(shot, tmp_path)
    key.location = (-1.0, 0.6, 0.8)
    bpy.context.view_layer.update()
    assert relume.Relighter(tmp_path / "bake").rarely_met(load_scene(shot).lights()) == ["Key"]
    found = render(shot, tmp_path)["Combined_Key"]
    shot.relume.folder = str(tmp_path / "other")
    assert (render(shot, tmp_path)["Combined_Key"] == found).all()


def test_a_bake_that_was_found_elsewhere_is_used(shot, tmp_path):
    first = render(shot, tmp_path)["Combined"]
    (tmp_path / "bake").rename(tmp_path / "moved")
    remember_bake(shot, tmp_path / "moved")
    assert (render(shot, tmp_path)["Combined"] == first).all()
    assert not (tmp_path / "bake").exists()


@pytest.mark.parametrize("word", ["Nothing", "Stereo", "folder"])
def test_what_goes_wrong_is_said_and_nothing_hangs(shot, tmp_path, word):
    if word == "Nothing":
        bpy.data.objects.remove(shot.objects["Plane"])
    elif word == "Stereo":
        shot.render.use_multiview = True
    else:
        (tmp_path / "file").write_text("not a folder")
        shot.relume.folder = str(tmp_path / "file" / "bake")
    with pytest.raises(RuntimeError, match="(?i)relume"):
        bpy.ops.render.render()


def test_stopping_leaves_no_picture_and_no_error(shot, tmp_path, monkeypatch):
    monkeypatch.setattr(render_engine._FinalRender, "_is_stopped", lambda self: True)
    bpy.ops.render.render()
    assert not (tmp_path / "bake").exists()


def test_disabling_ends_a_render_and_enabling_allows_it_again(shot, tmp_path):
    render_engine.stop_all()
    with pytest.raises(RuntimeError, match="disabled while it rendered"):
        bpy.ops.render.render()
    assert not (tmp_path / "bake").exists()
    addon.unregister()
    assert not ui.RelumeRenderEngine.is_registered
    addon.register()
    shot.relume.folder = str(tmp_path / "bake")
    assert render(shot, tmp_path)["Combined"].max() > 0.0


def test_a_view_says_why_it_shows_nothing(shot, monkeypatch):
    opened = SimpleNamespace(camera="Camera", picture=None, is_working=True, is_seen_beside=False)
    assert "Start" in rendered.why_not(shot, None, shot.camera)
    monkeypatch.setattr(open_shots, "all_of", lambda _scene: [opened])
    assert "'Camera'" in rendered.why_not(shot, None, None)
    assert "No bake" in rendered.why_not(shot, None, shot.objects["Key"])
    assert "on its way" in rendered.why_not(shot, opened, shot.camera)
    opened.picture = object()
    assert rendered.why_not(shot, opened, shot.camera) == ""


def test_pass_names_are_those_of_the_command_line():
    names = light_passes(["Key.001", "Key_001", "", "Spot \u00e9", "x" * 70, "x" * 71])
    long = "Combined_" + "x" * 54
    assert list(names.values()) == [
        "Combined_Key_001",
        "Combined_Key_001_2",
        "Combined_light",
        "Combined_Spot _",
        long,
        long[:-2] + "_2",
    ]


def test_no_pass_is_lost_by_a_long_name(shot, tmp_path):
    shot.view_layers[0].name = "A view layer with a long name"
    name = "A practical lamp with a name as long as Blender keeps, number "
    for number in "12":
        add_light(shot, "POINT", name=name + number, shadow_soft_size=0.5)
    passes = render(shot, tmp_path)
    lights = [found for found in passes if found.startswith("Combined_")]
    assert len(lights) == 4, lights
    total = sum(passes[found] for found in [*lights, "static", "world"])
    np.testing.assert_allclose(total, passes["Combined"][..., :3], atol=1e-5)


def test_each_view_layer_is_rendered_as_it_is(shot, tmp_path):
    shot.view_layers.new("Nothing").use_sky = False
    shot.view_layers["Nothing"].material_override, *_ = add_material("Black")
    bpy.ops.render.render(write_still=True)
    layers = {layer: 0.0 for layer in ("ViewLayer", "Nothing")}
    for name, channel in read_exr(tmp_path / "f12.exr").items():
        layer, found, _ = name.split(".")
        layers[layer] += channel.sum() * (found == "Combined_Key")
    assert layers["ViewLayer"] > 0.0 and layers["Nothing"] == 0.0


def test_sockets_have_the_names_of_the_passes(shot, tmp_path):
    linked = instance_linked_light(shot, tmp_path)
    shot.objects["Key"].hide_render = True
    names = []
    engine = SimpleNamespace(register_pass=lambda _scene, _layer, name, *_rest: names.append(name))
    ui.RelumeRenderEngine.update_render_passes(engine, shot, bpy.context.view_layer)
    assert set(light_passes(["Rim.001", linked]).values()) == {name for name in names if name.startswith("Combined_")}


def test_each_instance_of_a_light_has_a_socket_where_it_is_known(shot, tmp_path, monkeypatch):
    rig = bpy.data.collections.new("Rig")
    rig.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    for place in (-1.0, 1.0):
        empty = add(shot, "Lamp", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", rig
        empty.location = (place, 0.0, 2.0)
    passes = render(shot, tmp_path)
    known = SimpleNamespace(lights=SimpleNamespace(descriptions=json.loads(load_scene(shot).lights())))
    monkeypatch.setattr(ui.shots, "of", lambda _scene: known)
    names = []
    engine = SimpleNamespace(register_pass=lambda _scene, _layer, name, *_rest: names.append(name))
    ui.RelumeRenderEngine.update_render_passes(engine, shot, bpy.context.view_layer)
    assert "Combined_Bulb#2" in names and set(names) == set(passes)


def test_panels_of_cycles_show_and_go_again():
    def shown():
        return {panel.__name__ for panel in ui._panels() if "RELUME" in panel.COMPAT_ENGINES}

    before = shown()
    addon.register()
    assert {"CYCLES_LIGHT_PT_light", "CYCLES_MATERIAL_PT_surface", "CYCLES_RENDER_PT_film"} <= shown()
    own = {"RELUME_PT_passes", "RELUME_PT_sampling", "RELUME_PT_shading_pass"}
    assert own <= shown()
    assert "CYCLES_RENDER_PT_sampling" not in shown()
    assert not {name for name in shown() if name.startswith("CYCLES_VIEW3D_PT_shading")}, "they would do nothing"
    addon.unregister()
    assert shown() - before <= own
    addon.register()
    assert own <= shown(), "enabling again shows them again"
    addon.unregister()
