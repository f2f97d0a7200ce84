"""Lights without shadow, with shadow linking, few bounces or without Multiple Importance, beside Cycles: means of small
pictures, within noise."""

import json

import bpy
import pytest

from addon.core.diff import sentences
from addon.core.receivers import with_names, with_numbers
from addon.engine.staleness.fingerprints import all_fingerprints
from addon.export.lights import rules_of_lights
from cards import node
from helpers import add_light, add_material, add_quad, both_lit

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 1024


def shaded(name, kind, **inputs):
    material, tree, output = add_material(name)
    tree.links.new(node(tree, kind, inputs).outputs[0], output.inputs["Surface"])
    return material


@pytest.fixture
def stage(scene):
    """A grey floor and a mirror beside it, seen from straight above; a lamp to each side, a plate before each."""
    grey = (0.5, 0.5, 0.5, 1.0)
    add_quad(scene, "Floor", size=8.0, material=shaded("Floor", "ShaderNodeBsdfDiffuse", Color=grey))
    mirror = add_quad(scene, "Mirror", size=0.4, material=shaded("Mirror", "ShaderNodeBsdfGlossy", Roughness=0.0))
    mirror.location, mirror.rotation_euler = (0.3, 0.3, 0.1), (0.0, 0.35, 0.0)
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = 16
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.max_bounces = cycles.diffuse_bounces = 3
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    for name, x, angle in (("Right", 1.0, 1.2), ("Left", -1.0, -1.2)):
        add_light(scene, "POINT", name, (1.8 * x, 0.3, 1.6), shadow_soft_size=0.2, energy=100.0)
        material = shaded(name, "ShaderNodeBsdfDiffuse", Color=grey)
        plate = add_quad(scene, f"Plate {name}", size=1.6, material=material)
        plate.location, plate.rotation_euler = (0.9 * x, 0.2, 0.9), (0.0, angle, 0.0)
    return scene


def linked(light, name, state="INCLUDE"):
    """Links the shadows of a light to one object."""
    collection = bpy.data.collections.new(f"Blockers of {light.name}")
    collection.objects.link(bpy.data.objects[name])
    collection.collection_objects[0].light_linking.link_state = state
    light.light_linking.blocker_collection = collection


def as_usual(_right, _left):
    pass


def without_shadow(right, _left):
    right.data.use_shadow = False


def blocked_by_one(right, left):
    linked(right, "Plate Left")
    linked(left, "Plate Left")


def blocked_by_all_but_one(right, _left):
    bpy.data.objects.remove(bpy.data.objects["Mirror"])  # Mirrors see such lights through what Relume has them behind.
    linked(right, "Plate Right", "EXCLUDE")


def direct_only(right, _left):
    right.data.use_shadow = False
    for light in (right, _left):
        light.data.cycles.max_bounces = 0


def sampled_only(right, left):
    right.data.use_shadow = False
    right.data.cycles.use_multiple_importance_sampling = False


CASES = (as_usual, without_shadow, blocked_by_one, blocked_by_all_but_one, direct_only, sampled_only)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_light_falls_as_in_cycles(stage, case, tmp_path):
    scene = stage
    lights = [scene.objects[name] for name in ("Right", "Left")]
    case(*lights)
    ours, cycles = both_lit(scene, tmp_path / "bake", SAMPLES)
    # Cycles finds some of a lamp by chance, where its rules do not count.
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02, abs=5e-4)


def collected(*names, state="INCLUDE"):
    """A collection of light linking with these objects."""
    collection = bpy.data.collections.new("Linked")
    for name in names:
        collection.objects.link(bpy.data.objects[name])
        collection.collection_objects[-1].light_linking.link_state = state
    return collection


def shines_on_floor(linking):
    linking.receiver_collection = collected("Floor")


def shines_on_all_but_floor(linking):
    linking.receiver_collection = collected("Floor", state="EXCLUDE")


def blocked_by_left(linking):
    linking.blocker_collection = collected("Plate Left")


@pytest.mark.parametrize(
    "case", (shines_on_floor, shines_on_all_but_floor, blocked_by_left), ids=lambda case: case.__name__
)
def test_meshes_shine_as_in_cycles(stage, case, tmp_path):
    """The floor without the mirror: in mirrors Cycles shows what shines through all that does not block it."""
    for name in ("Right", "Left"):
        lamp = stage.objects[name]
        tube = add_quad(
            stage, f"Tube {name}", size=0.4, material=shaded(f"Tube {name}", "ShaderNodeEmission", Strength=20.0)
        )
        tube.matrix_world = lamp.matrix_world
        tube.location, tube.rotation_euler = lamp.location, (0.0, 0.9 if name == "Right" else -0.9, 0.0)
        bpy.data.objects.remove(lamp)
    if case is blocked_by_left:
        bpy.data.objects.remove(bpy.data.objects["Mirror"])
    stage.world.use_nodes = False
    case(stage.objects["Tube Right"].light_linking)
    ours, cycles = both_lit(stage, tmp_path / "bake", SAMPLES)
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02, abs=5e-4)


def test_links_of_meshes_are_a_part_of_the_bake(stage):
    before = all_fingerprints(stage, stage.camera)
    stage.objects["Mirror"].light_linking.receiver_collection = collected("Floor")
    said = sentences(["object Mirror"], before, all_fingerprints(stage, stage.camera))
    assert said == ["Light linking of 'Mirror' was changed"]


def test_rules_are_a_part_of_the_bake(stage):
    right = stage.objects["Right"]
    assert rules_of_lights(stage) == []
    right.data.use_shadow = False
    assert [json.loads(rules) for rules in rules_of_lights(stage)] == [{"blockers": {"receivers": []}}]
    right.hide_render = True
    assert rules_of_lights(stage) == []


def test_kept_requests_name_blockers():
    rules = {"blockers": {"receivers": [1]}, "max_bounces": 2}
    request = json.dumps({"lights": [{"name": "Key", "rules": rules}]})
    kept = with_names(request, ["Floor", "Wall", "Ball"])
    assert json.loads(kept)["lights"][0]["rules"] == {"blockers": {"names": ["Wall"]}, "max_bounces": 2}
    assert json.loads(with_numbers(kept, ["Wall", "Floor"]))["lights"][0]["rules"]["blockers"] == {"receivers": [0]}
