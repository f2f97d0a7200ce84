"""Light where shadow rays see otherwise than paths, and Light Path, beside Cycles: means of small pictures."""

import bpy
import pytest

from cards import Cards, differences, node
from helpers import add_light, add_material, add_quad, both_lit

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 1024
GREY = {"Color": (0.5, 0.5, 0.5, 1.0)}
WHITE = {"Color": (1.0, 1.0, 1.0, 1.0)}


@pytest.fixture
def stage(scene):
    """A grey floor, seen from straight above by parallel rays, a lamp to one side, and a plate between the two."""
    material, tree, output = add_material("Floor")
    tree.links.new(node(tree, "ShaderNodeBsdfDiffuse", GREY).outputs[0], output.inputs["Surface"])
    add_quad(scene, "Floor", size=8.0, material=material)
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = 8
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = False
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    add_light(scene, "POINT", location=(1.8, 0.3, 1.6), shadow_soft_size=0.1)
    material, tree, output = add_material("Plate")
    plate = add_quad(scene, "Plate", size=2.0, material=material)
    plate.location, plate.rotation_euler = (0.9, 0.2, 0.9), (0.0, 1.2, 0.0)
    return scene, plate, tree, output


def shade(tree, output, kind, inputs=GREY):
    shader = node(tree, kind, inputs).outputs[0]
    tree.links.new(shader, output.inputs["Surface"])
    return shader


def mix(tree, output, socket, first, second):
    """One shader, and another for some rays."""
    path = node(tree, "ShaderNodeLightPath").outputs[socket]
    mixed = node(tree, "ShaderNodeMixShader", {0: path, 1: first, 2: second})
    tree.links.new(mixed.outputs[0], output.inputs["Surface"])


def no_shadow(plate, tree, output):
    shade(tree, output, "ShaderNodeBsdfDiffuse")
    plate.visible_shadow = False


def hidden_blocker(plate, tree, output):
    shade(tree, output, "ShaderNodeBsdfDiffuse")
    plate.visible_diffuse = False


def opaque_shadows(plate, tree, output):
    shade(tree, output, "ShaderNodeBsdfTransparent")
    bpy.data.materials["Plate"].use_transparent_shadow = False


def clear_to_shadows(_plate, tree, output):
    glass = node(tree, "ShaderNodeBsdfGlass", {"Roughness": 0.0}).outputs[0]
    mix(tree, output, "Is Shadow Ray", glass, node(tree, "ShaderNodeBsdfTransparent", GREY).outputs[0])


def clear_to_diffuse_rays(_plate, tree, output):
    diffuse = node(tree, "ShaderNodeBsdfDiffuse", GREY).outputs[0]
    mix(tree, output, "Is Diffuse Ray", diffuse, node(tree, "ShaderNodeBsdfTransparent", WHITE).outputs[0])


def blocking(_plate, tree, output):
    shade(tree, output, "ShaderNodeBsdfDiffuse")


CASES = (blocking, no_shadow, hidden_blocker, opaque_shadows, clear_to_shadows, clear_to_diffuse_rays)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_light_passes_the_plate_as_in_cycles(stage, case, tmp_path):
    scene, plate, tree, output = stage
    case(plate, tree, output)
    ours, cycles = both_lit(scene, tmp_path / "bake", SAMPLES)
    # Cycles finds a hundredth of the lamp's light by chance, wherever the plate is.
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.02, abs=5e-4)


OUTPUTS = (
    "Is Camera Ray",
    "Is Diffuse Ray",
    "Is Glossy Ray",
    "Is Singular Ray",
    "Is Reflection Ray",
    "Is Transmission Ray",
    "Ray Length",
    "Ray Depth",
    "Diffuse Depth",
    "Glossy Depth",
    "Transparent Depth",
    "Transmission Depth",
)
RECEIVERS = {
    "diffuse": ("ShaderNodeBsdfDiffuse", WHITE),
    "glossy": ("ShaderNodeBsdfGlossy", WHITE | {"Roughness": 0.5}),
    "mirror": ("ShaderNodeBsdfGlossy", WHITE | {"Roughness": 0.0}),
    "translucent": ("ShaderNodeBsdfTranslucent", WHITE),
    "refraction": ("ShaderNodeBsdfRefraction", WHITE | {"IOR": 1.2, "Roughness": 0.0}),
    "clear": ("ShaderNodeBsdfTransparent", WHITE),
}


@pytest.mark.parametrize("socket", OUTPUTS)
def test_light_path_tells_of_rays_as_in_cycles(scene, socket, tmp_path):
    """A ceiling and a deep floor glow as the output says; cards between them reflect, or let through."""
    cards = Cards(scene, columns=3)
    for name, (kind, inputs) in RECEIVERS.items():
        tree, output = cards.add(name)
        cards.show(tree, output, node(tree, kind, inputs).outputs[0])
    material, tree, output = add_material("Glow")
    path = node(tree, "ShaderNodeLightPath").outputs[socket]
    emission = node(tree, "ShaderNodeEmission", {"Color": path})
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    material.cycles.emission_sampling = "NONE"
    for name, height in (("Ceiling", 2.0), ("Deep", -2.0)):
        add_quad(scene, name, size=12.0, material=material).location.z = height
    scene.objects["Ceiling"].visible_camera = False
    scene.cycles.max_bounces = 2
    means, warnings = cards.means(tmp_path, samples=64)
    assert warnings == []
    assert max(cycles.max() for _, cycles in means.values()) > 0.5
    assert differences(means, 0.03) == {}
