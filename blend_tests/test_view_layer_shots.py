"""View layers as shots: they fill the list, and a render of several uses the bake of each."""

import json

import bpy
import numpy as np
import pytest

from addon.commands import run
from addon.engine.render import render_engine
from addon.engine.shot import background, shot, shot_list
from addon.export.current_shot import entries
from addon.export.view_layer import entry_of_layer
from addon.live import rows
from exr import read_exr
from helpers import add_light, add_quad, row, write_multilayer

pytestmark = pytest.mark.oldest_and_newest

LAYERS = ("View", "fg.v2/hero", "back")


@pytest.fixture
def layered(studio):
    """Three layers of which each lacks a quad of its own, the first one all lights but one."""
    studio.relume.samples = 4
    studio.cycles.use_denoising = False
    add_light(studio, "POINT", name="Rim", location=(1, 1, 1))
    for number, name in enumerate(LAYERS):
        layer = studio.view_layers[0] if not number else studio.view_layers.new(name)
        layer.name = name
        own = bpy.data.collections.new(f"Only {number}")
        studio.collection.children.link(own)
        quad = add_quad(studio, f"Quad {number}", size=0.5)
        quad.location = (number - 1.0, 0.0, 0.5)
        studio.collection.objects.unlink(quad)
        own.objects.link(quad)
    for layer in studio.view_layers:
        for number, name in enumerate(LAYERS):
            layer.layer_collection.children[f"Only {number}"].exclude = name != layer.name
    bpy.context.view_layer.update()
    yield studio
    background.close_all()
    shot.close_all()


def rendered(scene, file):
    """Channels of a render of all layers that are rendered."""
    scene.render.engine = "RELUME"
    write_multilayer(scene, file)
    bpy.ops.render.render(write_still=True)
    return read_exr(file)


def channels_of(found, layer):
    """Channels of one layer."""
    return {name: values for name, values in found.items() if name.startswith(f"{layer}.")}


def test_the_list_is_filled_with_layers_that_have_no_shot(layered):
    layered.view_layers["back"].use = False
    assert bpy.ops.relume.add_view_layers() == {"FINISHED"}
    assert [(entry.name, entry.layer, entry.camera) for entry in entries(layered)] == [
        ("View", "View", layered.camera),
        ("fg.v2/hero", "fg.v2/hero", layered.camera),
    ]
    assert shot_list.problems(layered) == {}
    layered.view_layers["back"].use = True
    assert bpy.ops.relume.add_view_layers() == {"FINISHED"}
    assert [entry.layer for entry in entries(layered)] == list(LAYERS)
    assert bpy.ops.relume.add_view_layers() == {"CANCELLED"}
    layered.relume_shots.items.clear()
    bpy.ops.relume.add_cameras()
    bpy.ops.relume.add_view_layers()
    assert [entry.layer for entry in entries(layered)] == ["", *LAYERS[1:]], "the camera's shot is of the first layer"
    assert [entry_of_layer(layered, name).name for name in LAYERS] == ["Camera", *LAYERS[1:]]
    layered.camera = None
    with pytest.raises(RuntimeError, match="no camera"):
        bpy.ops.relume.add_view_layers()


def test_a_render_of_several_layers_has_the_bake_of_each(layered, tmp_path, monkeypatch):
    singles = {}
    for name in LAYERS:
        for layer in layered.view_layers:
            layer.use = layer.name == name
        singles |= channels_of(rendered(layered, tmp_path / "single.exr"), name)
        layered.relume.folder = str(tmp_path / f"bake {name.replace('/', '_')}")
    for layer in layered.view_layers:
        layer.use = True
    layered.relume.folder = str(tmp_path / "shots")
    bpy.ops.relume.add_view_layers()
    assert run(["bake", "--shots", "all", "--quiet"]) == 0
    baked = []
    bake = render_engine._FinalRender._bake
    monkeypatch.setattr(render_engine._FinalRender, "_bake", lambda *found: (baked.append(found[2]), bake(*found)))
    together = rendered(layered, tmp_path / "all.exr")
    assert baked == [], "the bakes of the three shots serve"
    assert {name for name in together if name.split(".")[-2].startswith("Combined")} <= singles.keys()
    for name, values in singles.items():
        np.testing.assert_array_equal(together[name], values, err_msg=name)
    assert any(np.any(together[f"{LAYERS[0]}.Combined.R"] != together[f"{name}.Combined.R"]) for name in LAYERS[1:])
    layered.relume_shots.items.remove(1)
    rest = rendered(layered, tmp_path / "rest.exr")
    assert len(baked) == 1 and tmp_path not in baked[0].parents, "a layer without a shot has a bake for this picture"
    np.testing.assert_array_equal(rest[f"{LAYERS[1]}.Combined.R"], singles[f"{LAYERS[1]}.Combined.R"])


def test_each_layer_is_lit_by_the_values_of_its_shot(layered, tmp_path):
    bpy.ops.relume.add_view_layers()
    rows.sync(layered)
    rim = row(layered, "Rim")
    rows.give_own_values(rim, entries(layered)[2].key, rim.values())
    rows.own_values(row(layered, "Rim"), entries(layered)[2].key).on = False
    assert run(["bake", "--shots", "all", "--quiet"]) == 0
    found = rendered(layered, tmp_path / "all.exr")
    lit = [bool(np.any(found[f"{name}.Combined_Rim.R"])) for name in LAYERS]
    assert lit == [True, True, False]
    listed = json.loads((tmp_path / "bake" / "Scene_shots.json").read_text())
    assert [entry["layer"] for entry in listed["shots"]] == list(LAYERS)
