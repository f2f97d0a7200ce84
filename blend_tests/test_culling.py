"""Culling of Simplify, beside Cycles: what is left out is in no mirror either."""

import bpy
import numpy as np
import pytest

from addon.core.diff import sentences
from addon.engine.staleness.fingerprints import all_fingerprints
from cards import node
from helpers import add_material, add_quad, both_lit, exported

pytestmark = pytest.mark.oldest_and_newest

PLACES = {"Near": (-0.6, 0.6, 0.5), "Right": (2.1, 1.0, 1.0), "High": (0.0, 2.0, 3.0), "Behind": (0.2, -7.0, 0.5)}


@pytest.fixture
def stage(scene):
    """A mirror seen aslant, and glowing plates above it, some only in the mirror; all but the mirror may be culled."""
    shaders = {
        "Mirror": node_of("Mirror", "ShaderNodeBsdfGlossy", Roughness=0.0),
        "Glow": node_of("Glow", "ShaderNodeEmission"),
    }
    add_quad(scene, "Floor", size=30.0, material=shaders["Mirror"])
    for name, place in PLACES.items():
        add_quad(scene, name, size=0.8, material=shaders["Glow"]).location = place
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.location, camera.rotation_euler, camera.data.lens = (0.0, -4.0, 3.0), (0.95, 0.0, 0.0), 60.0
    render.resolution_x = render.resolution_y = 16
    cycles.pixel_filter_type, cycles.max_bounces = "BOX", 1
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    return scene


def node_of(name, kind, **inputs):
    material, tree, output = add_material(name)
    tree.links.new(node(tree, kind, inputs).outputs[0], output.inputs["Surface"])
    return material


def cull(scene, by_camera=False, by_distance=False, margin=0.1, distance=5.4):
    cycles = scene.cycles
    scene.render.use_simplify, cycles.use_camera_cull, cycles.use_distance_cull = True, by_camera, by_distance
    cycles.camera_cull_margin, cycles.distance_cull_margin = margin, distance
    for name in PLACES:
        settings = scene.objects[name].cycles
        settings.use_camera_cull = settings.use_distance_cull = True


def left_out(scene):
    return set(PLACES) - {instance["name"] for instance in exported(scene)["instances"]}


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, set()),
        ({"by_camera": True, "margin": 0.0}, {"Right", "High", "Behind"}),
        ({"by_camera": True, "margin": 0.1}, {"High", "Behind"}),
        ({"by_distance": True}, {"High"}),
        ({"by_distance": True, "distance": 3.0}, set(PLACES)),
        ({"by_camera": True, "by_distance": True, "margin": 0.0}, {"High"}),
    ],
)
def test_what_is_left_out_is_that_of_cycles(stage, settings, expected, tmp_path):
    cull(stage, **settings)
    assert left_out(stage) == expected
    ours, cycles = both_lit(stage, tmp_path / "bake", 256)
    # Edges within pixels are noise.
    assert float(np.abs(ours - cycles).mean()) <= 0.01 * float(cycles.mean())


def test_culling_is_a_part_of_the_bake(stage):
    before = all_fingerprints(stage, stage.camera)
    cull(stage, by_camera=True)
    said = sentences(["settings", "object Near"], before, all_fingerprints(stage, stage.camera))
    assert said == ["Culling of Simplify changed", "Culling of 'Near' was switched on or off"]
