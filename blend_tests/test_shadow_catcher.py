"""Shadow catchers beside Cycles: alpha of a transparent film, the world dimmed on an opaque one, and their own pass."""

import bpy
import numpy as np
import pytest
import relume

import addon
from addon.engine.reading.scene import load_scene
from cards import node
from exr import read_exr
from helpers import add, add_light, add_material, add_quad, add_world, both_lit, exported

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 256


def plain(name, color):
    material, tree, output = add_material(name)
    diffuse = node(tree, "ShaderNodeBsdfDiffuse", {"Color": (*color, 1.0)})
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture
def stage(scene):
    """A floor that catches the shadow of a card above it, and an ordinary card that covers a corner of it."""
    add_world(scene, (0.4, 0.6, 0.8), 1.0)
    add_light(scene, "AREA", location=(1.5, 0.0, 4.0), size=1.0, energy=300.0)
    floor = add_quad(scene, "Floor", size=3.0, material=plain("Grey", (0.7, 0.6, 0.5)))
    floor.is_shadow_catcher = True
    for name, color, place in (("Card", (0.8, 0.1, 0.1), (0.3, 0.0, 0.6)), ("Side", (0.2, 0.5, 0.2), (-1.5, 1.5, 0.1))):
        add_quad(scene, name, size=1.0, material=plain(name, color)).location = place
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", 4.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 6.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = 32
    render.image_settings.color_mode = "RGBA"
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    return scene


def blocks(image):
    """Means of 4 by 4 pixels."""
    height, width, channels = image.shape
    return image.reshape(height // 4, 4, width // 4, 4, channels).mean(axis=(1, 3))


@pytest.mark.parametrize("film_transparent", [True, False], ids=["transparent", "opaque"])
def test_shadows_are_caught_as_in_cycles(stage, film_transparent, tmp_path):
    stage.render.film_transparent = film_transparent
    pictures = both_lit(stage, tmp_path / "bake", SAMPLES, channels=4)
    ours, theirs = map(blocks, pictures)
    assert (np.abs(ours - theirs) < 0.02 + 0.03 * theirs).all(), (ours - theirs).round(3)
    assert ours[3, 1, 3] < 0.1 and ours[3, 3, 3] > 0.7 if film_transparent else ours[3, 3, 1] < 0.5 * ours[3, 1, 1]


def test_instances_catch_if_they_or_what_instances_them_do(scene):
    for place, (inner, outer) in enumerate(((True, False), (False, True), (False, False))):
        source = add_quad(scene, f"Card {place}")
        source.is_shadow_catcher = inner
        collection = bpy.data.collections.new(f"Source {place}")
        collection.objects.link(source)
        scene.collection.objects.unlink(source)
        empty = add(scene, f"Instance {place}", None)
        empty.instance_type, empty.instance_collection, empty.is_shadow_catcher = "COLLECTION", collection, outer
    assert [found["is_shadow_catcher"] for found in exported(scene)["instances"]] == [True, True, False]


def test_a_lamp_that_is_kept_from_catchers_is_named(stage):
    assert exported(stage)["warnings"] == []
    stage.objects["Lamp"].is_shadow_catcher = stage.objects["Floor"].is_shadow_catcher = False
    assert exported(stage)["warnings"] == []
    stage.objects["Floor"].is_shadow_catcher = True
    assert "kept from shadow catchers" in " ".join(exported(stage)["warnings"])


def passes_of(path):
    """Passes of a file by name, [height, width, channels]."""
    passes = {}
    for name, channel in read_exr(path).items():
        _, name, letter = name.split(".")
        passes.setdefault(name, {})[letter] = channel
    letters = {name: [letter for letter in "RGBA" if letter in found] for name, found in passes.items()}
    return {name: np.stack([found[each] for each in letters[name]], axis=-1) for name, found in passes.items()}


def test_the_pass_of_a_final_render_is_that_of_cycles(stage, tmp_path):
    stage.render.film_transparent = stage.view_layers[0].cycles.use_pass_shadow_catcher = True
    output = stage.render.image_settings
    if hasattr(output, "media_type"):
        output.media_type = "MULTI_LAYER_IMAGE"
    output.file_format, output.color_depth = "OPEN_EXR_MULTILAYER", "32"
    output.exr_codec = "NONE"
    stage.cycles.samples, stage.cycles.use_denoising = SAMPLES, False
    pictures = {}
    addon.register()
    try:
        stage.relume.quality, stage.relume.samples, stage.relume.folder = "CUSTOM", SAMPLES, str(tmp_path / "bake")
        for engine in ("RELUME", "CYCLES"):
            stage.render.engine, stage.render.filepath = engine, str(tmp_path / f"{engine}.exr")
            bpy.ops.render.render(write_still=True)
            pictures[engine] = passes_of(tmp_path / f"{engine}.exr")
        ours, theirs = pictures["RELUME"], pictures["CYCLES"]
        for name in ("Combined", "Shadow Catcher"):
            found, expected = blocks(ours[name]), blocks(theirs[name])
            # Denoised pictures of so few pixels bleed over edges.
            assert (np.abs(found - expected) < 0.03 + 0.05 * expected).all(), (name, (found - expected).round(3))
        assert 0.2 < blocks(ours["Shadow Catcher"])[..., 1].min() < 0.6
        names = ("static", "world", "Combined_Lamp")
        assert ours["Combined"][..., :3] == pytest.approx(sum(ours[name] for name in names), rel=1e-5)
    finally:
        addon.unregister()


def test_a_brighter_lamp_deepens_its_shadow_without_a_new_bake(stage, tmp_path):
    stage.render.film_transparent = True
    found = load_scene(stage)
    relume.bake(found, tmp_path / "bake", {"samples": 64, "paths": {"film_transparent": True}}).wait()
    relighter = relume.Relighter(tmp_path / "bake")
    dim, bright = (relighter.relight(found.lights(), world=[gain] * 3, denoise=False) for gain in (1.0, 0.1))
    assert dim["combined"].shape == (32, 32, 3) and dim["albedo"].shape == (32, 32, 3)
    shadow = (slice(14, 18), slice(12, 16))
    assert bright["alpha"][shadow].mean() > dim["alpha"][shadow].mean() + 0.05
