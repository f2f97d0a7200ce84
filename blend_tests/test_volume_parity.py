"""Volumes with grids, as Relume and as Cycles render them."""

import bpy
import numpy as np
import pytest
import relume
from vdb_file import write_vdb
from volume_objects import add_file, add_mesh_to_volume, add_nodes, smoke

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add, add_light, add_material, add_quad, render_cycles

pytestmark = pytest.mark.oldest_and_newest

PIXELS, BLOCKS, SEEDS = 16, 2, 4


def set_up(scene, volume_bounces=0):
    """A camera that looks down on a white floor, under a lamp that Cycles samples alone: within media its multiple
    importance sampling is wrong."""
    add_quad(scene, "Floor", size=6.0, material=white()).location.z = -1.5
    lamp = add_light(scene, "POINT", "Key", (1.5, -1.0, 2.5), shadow_soft_size=0.3)
    lamp.data.cycles.use_multiple_importance_sampling = False
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    scene.render.resolution_x = scene.render.resolution_y = PIXELS
    scene.world = bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    cycles = scene.cycles
    cycles.max_bounces, cycles.volume_bounces, cycles.pixel_filter_type = 4, volume_bounces, "BOX"
    cycles.volume_step_rate = 0.1  # Up to Blender 4.5; coarse steps let too much light pass.


def white():
    """A white diffuse material."""
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (0.9, 0.9, 0.9, 1.0)
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    return material


def blocks(image):
    """Mean colours of squares of pixels."""
    edge = PIXELS // BLOCKS
    return image.reshape(BLOCKS, edge, BLOCKS, edge, 3).mean(axis=(1, 3))


def assert_equal_to_cycles(scene, tmp_path, samples=16):
    """Compares blocks of both pictures: within three standard errors of independent seeds, and half a percent."""
    bpy.context.view_layer.update()
    found = load_scene(scene)
    ours, theirs = [], []
    for seed in range(SEEDS):
        folder = tmp_path / f"bake{seed}"
        settings = trace_settings(scene, lambda _: None) | {"samples": samples, "seed": seed}
        relume.bake(found, folder, settings).wait()
        picture = relume.Relighter(folder).relight(found.lights(), denoise=False)["combined"]
        ours.append(blocks(picture[::-1]))
        theirs.append(blocks(render_cycles(scene, samples, seed=seed)))
    error = np.sqrt((np.var(ours, axis=0, ddof=1) + np.var(theirs, axis=0, ddof=1)) / SEEDS)
    ours, theirs = np.mean(ours, axis=0), np.mean(theirs, axis=0)
    # Variances of four seeds are noisy themselves: blocks share theirs.
    error = np.maximum(error, np.sqrt(np.mean(error**2)))
    excess = np.abs(ours - theirs) - 3.0 * error - 0.005 * theirs
    ratio = ours.mean() / theirs.mean()
    assert excess.max() < 0.0, f"mean ratio {ratio:.4f}, worst by {excess.max():.4g} of {theirs.mean():.4g}"
    assert abs(ratio - 1.0) < 3.0 * np.sqrt(np.mean(error**2) / error.size) / theirs.mean() + 0.005, f"{ratio:.4f}"


@pytest.mark.slow
def test_a_ball_of_mesh_to_volume(scene, tmp_path):
    def ball(tree):
        sphere, material = (tree.nodes.new(f"GeometryNode{kind}") for kind in ("MeshUVSphere", "SetMaterial"))
        sphere.inputs["Radius"].default_value = 1.0
        material.inputs["Material"].default_value = smoke(1.5)[0]
        volume = add_mesh_to_volume(tree, sphere.outputs[0], 0.1)
        tree.links.new(volume.outputs[0], material.inputs["Geometry"])
        return material.outputs[0]

    set_up(scene)
    add_nodes(scene, ball)
    assert_equal_to_cycles(scene, tmp_path)


@pytest.mark.slow
def test_colours_of_a_sequence_in_an_object_that_is_scaled(scene, tmp_path):
    x, y, z = np.indices((24, 24, 24)) / 23.0
    color = np.stack([0.2 + 0.8 * x, 0.9 - 0.6 * y, 0.4 + 0.4 * z], axis=-1)
    for frame, density in ((1, 1.0 + 0 * x), (2, 3.0 * x * (1.0 - y) + 0.1)):
        write_vdb(tmp_path / f"smoke_{frame:04d}.vdb", {"density": density, "color": color}, 0.05, (-0.6, -0.6, -0.6))
    set_up(scene)
    obj = add_file(scene, tmp_path / "smoke_0001.vdb")
    obj.data.is_sequence, obj.data.frame_start, obj.data.frame_duration = True, 1, 2
    obj.data.materials[0] = smoke(2.0, (1.0, 1.0, 1.0), "color")[0]
    obj.scale, obj.rotation_euler = (1.6, 1.2, 0.8), (0.0, 0.3, 0.5)
    scene.frame_set(2)
    assert_equal_to_cycles(scene, tmp_path)


@pytest.mark.slow
def test_a_density_through_a_ramp_scattered_more_than_once(scene, tmp_path):
    x, y, z = np.indices((20, 20, 20)) / 19.0 - 0.5
    bump = np.clip(1.0 - 2.0 * np.sqrt(x * x + y * y + z * z), 0.0, 1.0)
    write_vdb(tmp_path / "heat.vdb", {"heat": bump}, 0.1, (-0.95, -0.95, -0.95))
    set_up(scene, volume_bounces=3)
    obj = add_file(scene, tmp_path / "heat.vdb")
    material, tree, shader = smoke()
    attribute, ramp, gain = (tree.nodes.new(f"ShaderNode{kind}") for kind in ("Attribute", "ValToRGB", "Math"))
    attribute.attribute_name = "heat"
    ramp.color_ramp.elements[0].position, ramp.color_ramp.elements[1].position = 0.2, 0.6
    gain.operation, gain.inputs[1].default_value = "MULTIPLY", 4.0
    tree.links.new(attribute.outputs["Fac"], ramp.inputs["Fac"])
    tree.links.new(ramp.outputs["Color"], gain.inputs[0])
    tree.links.new(gain.outputs[0], shader.inputs["Density"])
    shader.inputs["Color"].default_value = (0.9, 0.6, 0.3, 1.0)
    obj.data.materials[0] = material
    assert_equal_to_cycles(scene, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_an_object_without_material_in_both_spaces_of_density(scene, tmp_path, space):
    write_vdb(tmp_path / "fog.vdb", {"density": np.full((16, 16, 16), 1.5)}, 0.1, (-0.75, -0.75, -0.75))
    set_up(scene)
    volume = bpy.data.volumes.new("Fog")
    volume.filepath, volume.render.space = str(tmp_path / "fog.vdb"), space
    add(scene, "Fog", volume).scale = (1.0, 2.0, 0.5)
    assert_equal_to_cycles(scene, tmp_path)


def wind(scene, tmp_path, splits_axes=False, **settings):
    """A ball of smoke in a wind that shears and grows, blurred."""
    x, y, z = np.indices((32, 32, 32)) / 31.0 - 0.5
    ball = np.clip(3.0 - 12.0 * np.sqrt(x * x + y * y + z * z), 0.0, 1.0)
    speeds = np.stack([0.9 + 1.2 * y, -0.5 * x, 0.3 + 0.0 * z], axis=-1)
    axes = {f"velocity_{axis}": speeds[..., number] for number, axis in enumerate("xyz")}
    grids = {"density": ball} | (axes if splits_axes else {"velocity": speeds})
    write_vdb(tmp_path / "wind.vdb", grids, 0.06, (-0.93, -0.93, -0.93))
    set_up(scene)
    scene.render.use_motion_blur, scene.render.motion_blur_shutter = True, 0.5
    obj = add_file(scene, tmp_path / "wind.vdb")
    obj.data.materials[0] = smoke(4.0)[0]
    for name, value in settings.items():
        setattr(scene.render if name == "motion_blur_position" else obj.data, name, value)
    return obj


@pytest.mark.slow
@pytest.mark.parametrize("position", ["START", "CENTER", "END"])
def test_smoke_in_the_wind(scene, tmp_path, position):
    wind(scene, tmp_path, motion_blur_position=position)
    assert_equal_to_cycles(scene, tmp_path, samples=48)


@pytest.mark.slow
def test_wind_by_the_second_of_three_grids_in_a_turned_object_that_moves(scene, tmp_path):
    obj = wind(scene, tmp_path, splits_axes=True, velocity_unit="SECOND", velocity_scale=30.0)
    obj.scale, obj.rotation_euler = (1.2, 0.8, 1.0), (0.2, 0.1, 0.6)
    obj.keyframe_insert("location", frame=0)
    obj.location.y = 0.6
    obj.keyframe_insert("location", frame=2)
    assert_equal_to_cycles(scene, tmp_path)
