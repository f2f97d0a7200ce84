"""Media beside Cycles: means of small pictures, within noise. The lamps are without Multiple Importance, with which
Cycles loses what is scattered in and behind a lamp."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import node
from helpers import add_light, add_material, add_quad, background, exported, render_cycles

pytestmark = pytest.mark.oldest_and_newest

SAMPLES = 2048


@pytest.fixture
def stage(scene):
    """A grey floor, seen from straight above by parallel rays, under a lamp to one side."""
    material, tree, output = add_material("Floor")
    grey = node(tree, "ShaderNodeBsdfDiffuse", {"Color": (0.5, 0.5, 0.5, 1.0)})
    tree.links.new(grey.outputs[0], output.inputs["Surface"])
    add_quad(scene, "Floor", size=8.0, material=material)
    camera, render = scene.camera, scene.render
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = 8
    cycles = scene.cycles
    cycles.pixel_filter_type, cycles.blur_glossy, cycles.volume_bounces = "BOX", 0.0, 3
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.volume_step_rate = 0.05
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    lamp = add_light(scene, "POINT", location=(1.4, 0.3, 1.6), shadow_soft_size=0.3)
    lamp.data.cycles.use_multiple_importance_sampling = False
    return scene


def fill(obj, *, surface=None, name="Fog"):
    """A material whose volume is to be linked; returns its tree and output."""
    material, tree, output = add_material(name)
    obj.data.materials.append(material)
    if surface is not None:
        tree.links.new(node(tree, *surface).outputs[0], output.inputs["Surface"])
    return tree, output


def cube(size=2.0, location=(0.0, 0.0, 1.1)):
    """A cube of a size at a place."""
    bpy.ops.mesh.primitive_cube_add(size=size, location=location)
    return bpy.context.object


def fog(obj, kind, inputs, **settings):
    """Fills a cube with one volume node."""
    tree, output = fill(obj)
    tree.links.new(node(tree, kind, inputs, **settings).outputs[0], output.inputs["Volume"])


def assert_equal_to_cycles(scene, tmp_path, samples=SAMPLES):
    """Compares the means of both pictures."""
    found = load_scene(scene)
    folder = tmp_path / "bake"
    relume.bake(found, folder, trace_settings(scene, lambda _: None) | {"samples": 2 * samples}).wait()
    ours = relume.Relighter(folder).relight(found.lights(), denoise=False)["combined"][::-1, :, :3]
    cycles = render_cycles(scene, samples=samples)
    difference = (ours - cycles).reshape(-1, 3)
    error = difference.std(axis=0) / np.sqrt(len(difference))
    mean = cycles.mean(axis=(0, 1))
    assert np.all(np.abs(difference.mean(axis=0)) <= 3.0 * error + 0.005 * mean), (
        ours.mean(axis=(0, 1)),
        mean,
        error,
    )
    assert np.all(error < 0.03 * mean.max()), "too noisy to tell"


def test_a_box_of_fog(stage, tmp_path):
    fog(cube(), "ShaderNodeVolumeScatter", {"Color": (0.8, 0.8, 0.8, 1.0), "Density": 0.6, "Anisotropy": 0.3})
    assert_equal_to_cycles(stage, tmp_path)


def test_tinted_fog_dims_channels_differently(stage, tmp_path):
    fog(cube(), "ShaderNodeVolumeScatter", {"Color": (0.9, 0.4, 0.15, 1.0), "Density": 0.8})
    assert_equal_to_cycles(stage, tmp_path)


def fill_space(scene):
    """Fills the world with fog."""
    world = scene.world
    if bpy.app.version < (5, 2, 0):
        world.use_nodes = True
    tree = world.node_tree
    volume = node(tree, "ShaderNodeVolumePrincipled", {"Color": (0.7, 0.8, 0.9, 1.0), "Density": 0.1})
    output = next(found for found in tree.nodes if found.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(volume.outputs[0], output.inputs["Volume"])


def test_fog_of_the_world(stage, tmp_path):
    fill_space(stage)
    assert_equal_to_cycles(stage, tmp_path)


def test_lamps_beyond_the_fog_that_was_baked_are_connected_or_else_named(stage, tmp_path):
    fill_space(stage)
    lamp = stage.objects["Lamp"]
    lamp.data.shadow_soft_size = 8.0
    settings = trace_settings(stage, lambda _: None) | {"samples": 8}
    relume.bake(load_scene(stage), tmp_path / "near", settings).wait()
    lamp.location.z = 60.0
    far = load_scene(stage)
    connected = relume.Relighter(tmp_path / "near")
    assert connected.rarely_met(far.lights()) == []
    (tmp_path / "near" / "scene.scene").unlink()
    crossed = relume.Relighter(tmp_path / "near")
    assert crossed.rarely_met() == [] and crossed.rarely_met(far.lights()) == ["Lamp"]
    assert not crossed.relight(far.lights(), denoise=False)["lights"]["Lamp"].any()
    relume.bake(far, tmp_path / "far", settings).wait()
    relighter = relume.Relighter(tmp_path / "far")
    assert relighter.rarely_met() == []
    found, expected = connected.relight(far.lights(), denoise=False), relighter.relight(denoise=False)
    assert found["lights"]["Lamp"].mean() == pytest.approx(expected["lights"]["Lamp"].mean(), rel=0.1)


def test_coloured_liquid_in_glass(stage, tmp_path):
    stage.cycles.max_bounces = stage.cycles.transmission_bounces = 8
    tree, output = fill(cube(), surface=("ShaderNodeBsdfGlass", {"IOR": 1.2, "Roughness": 0.3}))
    liquid = node(tree, "ShaderNodeVolumeAbsorption", {"Color": (0.9, 0.5, 0.2, 1.0), "Density": 0.5})
    tree.links.new(liquid.outputs[0], output.inputs["Volume"])
    # Lamps are seldom met through glass.
    stage.objects["Lamp"].hide_render = True
    stage.world = bpy.data.worlds.new("White")
    if bpy.app.version < (5, 2, 0):
        stage.world.use_nodes = True
    background(stage).inputs["Color"].default_value = (0.5, 0.5, 0.5, 1.0)
    assert_equal_to_cycles(stage, tmp_path, 2 * SAMPLES)


def test_overlapping_media(stage, tmp_path):
    fog(cube(), "ShaderNodeVolumeScatter", {"Color": (0.8, 0.8, 0.8, 1.0), "Density": 0.5, "Anisotropy": 0.6})
    fog(cube(1.2, (0.2, 0.0, 1.0)), "ShaderNodeVolumeAbsorption", {"Color": (0.3, 0.3, 0.3, 1.0), "Density": 0.8})
    assert_equal_to_cycles(stage, tmp_path)


def test_a_camera_in_fog(stage, tmp_path):
    stage.camera.location.z = 1.3
    fog(cube(), "ShaderNodeVolumeScatter", {"Color": (0.8, 0.8, 0.8, 1.0), "Density": 0.6})
    assert_equal_to_cycles(stage, tmp_path)


def test_density_by_a_texture(stage, tmp_path):
    tree, output = fill(cube())
    noise = node(tree, "ShaderNodeTexNoise", {"Scale": 2.0, "Detail": 1.0})
    ramp = node(tree, "ShaderNodeMapRange", {"Value": noise.outputs[0], "From Min": 0.4, "To Max": 3.0})
    smoke = node(tree, "ShaderNodeVolumePrincipled", {"Density": ramp.outputs[0], "Color": (0.8, 0.8, 0.8, 1.0)})
    tree.links.new(smoke.outputs[0], output.inputs["Volume"])
    assert_equal_to_cycles(stage, tmp_path, SAMPLES // 2)


@pytest.mark.parametrize("socket", ["Is Camera Ray", "Is Shadow Ray", "Is Diffuse Ray", "Ray Depth"])
def test_density_by_the_ray(stage, tmp_path, socket):
    tree, output = fill(cube())
    path = node(tree, "ShaderNodeLightPath").outputs[socket]
    density = node(tree, "ShaderNodeMath", {0: path, 1: 0.5, 2: 0.2}, operation="MULTIPLY_ADD")
    inputs = {"Density": density.outputs[0], "Color": (0.8, 0.8, 0.8, 1.0)}
    tree.links.new(node(tree, "ShaderNodeVolumeScatter", inputs).outputs[0], output.inputs["Volume"])
    assert_equal_to_cycles(stage, tmp_path)


@pytest.mark.slow
def test_smoke_and_its_glow_by_the_ray(stage, tmp_path):
    """A medium that differs from place to place too, under a shining plate."""
    stage.objects["Lamp"].hide_render = True
    material, tree, output = add_material("Shine")
    emission = node(tree, "ShaderNodeEmission", {"Strength": 4.0})
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(stage, "Plate", size=1.0, material=material).location = (1.4, 0.0, 1.2)
    tree, output = fill(cube())
    path = node(tree, "ShaderNodeLightPath").outputs
    noise = node(tree, "ShaderNodeTexNoise", {"Scale": 2.0, "Detail": 0.0}).outputs[0]
    density = node(tree, "ShaderNodeMath", {0: noise, 1: path["Is Shadow Ray"]}, operation="MULTIPLY_ADD")
    tree.links.new(path["Is Camera Ray"], density.inputs[2])
    glow = node(tree, "ShaderNodeMath", {0: path["Is Diffuse Ray"], 1: 0.2}, operation="MULTIPLY")
    inputs = {"Density": density.outputs[0], "Color": (0.8, 0.8, 0.8, 1.0), "Emission Strength": glow.outputs[0]}
    tree.links.new(node(tree, "ShaderNodeVolumePrincipled", inputs).outputs[0], output.inputs["Volume"])
    assert_equal_to_cycles(stage, tmp_path, SAMPLES // 2)


def test_glowing_gas(stage, tmp_path):
    stage.objects["Lamp"].hide_render = True
    inputs = {"Density": 0.5, "Emission Strength": 0.2, "Emission Color": (1.0, 0.3, 0.1, 1.0)}
    inputs |= {"Blackbody Intensity": 0.8, "Temperature": 1400.0}
    fog(cube(), "ShaderNodeVolumePrincipled", inputs)
    assert_equal_to_cycles(stage, tmp_path)


@pytest.mark.skipif(bpy.app.version < (4, 3, 0), reason="Blender 4.3 is the first with other phase functions")
@pytest.mark.parametrize(
    "phase, inputs",
    [
        ("FOURNIER_FORAND", {"IOR": 1.2, "Backscatter": 0.2}),
        ("DRAINE", {"Anisotropy": 0.4, "Alpha": 2.0}),
        ("RAYLEIGH", {}),
        ("MIE", {"Diameter": 20.0}),
        ("MIE", {"Diameter": 3.0}),
        ("MIE", {"Diameter": 0.8}),
        ("MIE", {"Diameter": 0.08}),
    ],
)
def test_phase_functions(stage, tmp_path, phase, inputs):
    stage.cycles.volume_bounces = 0
    bpy.data.objects["Floor"].hide_render = True
    fog(cube(), "ShaderNodeVolumeScatter", {"Density": 0.6, **inputs}, phase=phase)
    assert_equal_to_cycles(stage, tmp_path)


@pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="the node is new in Blender 4.5")
def test_coefficients(stage, tmp_path):
    inputs = {"Absorption Coefficients": (0.1, 0.2, 0.3), "Scatter Coefficients": (0.5, 0.4, 0.3)}
    fog(cube(), "ShaderNodeVolumeCoefficients", inputs | {"Emission Coefficients": (0.02, 0.01, 0.03)})
    assert_equal_to_cycles(stage, tmp_path)


def test_open_meshes_with_media_are_named(scene):
    fog(add_quad(scene, "Sheet"), "ShaderNodeVolumeScatter", {})
    fog(cube(), "ShaderNodeVolumeScatter", {})
    named = [warning for warning in exported(scene)["warnings"] if "open" in warning]
    assert len(named) == 1 and "'Sheet'" in named[0]
