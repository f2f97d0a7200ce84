"""Volumes in the exported scene: their grids against known functions, and what is said of those that cannot be read."""

import json
import math
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from vdb_file import write_vdb
from volume_objects import add_file, add_mesh_to_volume, add_nodes, smoke

from addon.engine.reading.scene import load_scene
from addon.export import scene as export_of_scenes
from addon.export import volumes
from helpers import add, add_quad, exported

pytestmark = pytest.mark.every_version


def volume_cube(tree, resolution=12):
    """Density 7 + x + 2 y + 3 z in the cube from -1 to 1."""
    cube = tree.nodes.new("GeometryNodeVolumeCube")
    for axis in "XYZ":
        cube.inputs[f"Resolution {axis}"].default_value = resolution
    position, dot, add_7 = (
        tree.nodes.new(f"{kind}") for kind in ("GeometryNodeInputPosition", "ShaderNodeVectorMath", "ShaderNodeMath")
    )
    dot.operation, dot.inputs[1].default_value = "DOT_PRODUCT", (1.0, 2.0, 3.0)
    add_7.operation, add_7.inputs[1].default_value = "ADD", 7.0
    tree.links.new(position.outputs[0], dot.inputs[0])
    tree.links.new(dot.outputs["Value"], add_7.inputs[0])
    tree.links.new(add_7.outputs[0], cube.inputs["Density"])
    return cube.outputs[0]


def fog_of(scene, name="Fog"):
    """The exported scene, and the instance of a volume in it."""
    add_quad(scene).location.z = -3.0
    found = load_scene(scene)
    summary = json.loads(found.summary())
    instance = next(each for each in summary["instances"] if each["grids"] is not None)
    return found, instance, summary["grids"][instance["grids"]]["grids"]


def places(grid, low, high, count=200):
    """Random positions in voxels, and the same in object space."""
    voxels = np.random.default_rng(1).uniform(low, high, (count, 3)).astype(np.float32)
    matrix = np.array(grid["object_from_index"]).reshape(4, 3)
    return voxels, (voxels @ matrix[:3] + matrix[3]).astype(np.float32)


def test_a_volume_cube_has_the_densities_of_its_function(scene):
    add_nodes(scene, volume_cube)
    found, instance, [grid] = fog_of(scene)
    assert (grid["name"], grid["channels"], grid["active"]) == ("density", 1, [[0, 0, 0], [11, 11, 11]])
    voxels, positions = places(grid, 0.0, 11.0)
    values = found.grid_values(instance["grids"], "density", positions)
    expected = 7.0 + (voxels * 2.0 / 11.0 - 1.0) @ np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(values[:, 0], expected, atol=2e-5)


def test_turned_volumes_lie_where_blender_says(scene):
    def turned(tree):
        transform = tree.nodes.new("GeometryNodeTransform")
        tree.links.new(volume_cube(tree), transform.inputs["Geometry"])
        transform.inputs["Rotation"].default_value = (0.3, -0.2, 0.5)
        transform.inputs["Scale"].default_value = (1.0, 2.0, 0.5)
        return transform.outputs[0]

    add_nodes(scene, turned)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    volume = next(each.object.data for each in depsgraph.object_instances if each.object.type == "VOLUME")
    volume.grids.load()
    matrix = np.array(volume.grids[0].matrix_object)
    _, _, [grid] = fog_of(scene)
    matrix[:3, 3] += matrix[:3, :3] @ np.full(3, volumes.SHIFT)
    np.testing.assert_allclose(np.array(grid["object_from_index"]).reshape(4, 3).T, matrix[:3], atol=1e-6)


def test_a_ball_of_mesh_to_volume_is_1_inside_and_0_outside(scene):
    def ball(tree):
        sphere = tree.nodes.new("GeometryNodeMeshUVSphere")
        sphere.inputs["Radius"].default_value = 2.0
        volume = add_mesh_to_volume(tree, sphere.outputs[0], 0.05)
        volume.inputs["Interior Band Width"].default_value = 0.2
        return volume.outputs[0]

    add_nodes(scene, ball)
    found, instance, [grid] = fog_of(scene)
    points = np.random.default_rng(1).normal(size=(2000, 3))
    points *= (np.random.default_rng(2).uniform(0.0, 2.6, 2000) / np.linalg.norm(points, axis=1))[:, None]
    radius = np.linalg.norm(points, axis=1)
    values = found.grid_values(instance["grids"], "density", points.astype(np.float32))[:, 0]
    assert np.all(values[radius < 1.6] == 1.0) and np.sum(radius < 1.6) > 500
    assert np.all(values[radius > 2.1] == 0.0) and np.sum(radius > 2.1) > 200


def test_scalars_and_colours_of_a_file_are_read_as_written(scene, tmp_path):
    index = np.indices((20, 11, 9)).astype(np.float32)
    color = np.moveaxis(index, 0, -1) + 1.0
    write_vdb(tmp_path / "smoke.vdb", {"density": 1.0 + index.sum(0), "color": color}, 0.1, (-1.0, -0.5, 0.25))
    add_file(scene, tmp_path / "smoke.vdb")
    found, instance, grids = fog_of(scene)
    assert sorted(grid["name"] for grid in grids) == ["color", "density"]
    voxels = np.random.default_rng(1).uniform(0.0, (19.0, 10.0, 8.0), (200, 3))
    positions = ((voxels + volumes.SHIFT) * 0.1 + (-1.0, -0.5, 0.25)).astype(np.float32)
    density = found.grid_values(instance["grids"], "density", positions)
    np.testing.assert_allclose(density[:, 0], 1.0 + voxels.sum(1), rtol=2e-5)
    np.testing.assert_allclose(found.grid_values(instance["grids"], "color", positions), voxels + 1.0, rtol=2e-5)


def test_a_sequence_shows_the_grids_of_the_frame(scene, tmp_path):
    for frame in (1, 2, 3):
        write_vdb(tmp_path / f"smoke_{frame:04d}.vdb", {"density": np.full((4, 4, 4), float(frame))})
    volume = add_file(scene, tmp_path / "smoke_0001.vdb").data
    volume.is_sequence, volume.frame_start, volume.frame_duration = True, 1, 3
    middle = np.array([[1.5, 1.5, 1.5]], np.float32)
    for frame in (2, 3):
        scene.frame_set(frame)
        found, instance, _ = fog_of(scene)
        assert found.grid_values(instance["grids"], "density", middle)[0, 0] == frame
    scene.frame_set(7)
    summary = exported(scene)
    assert not summary["grids"] and not any("Smoke" in warning for warning in summary["warnings"])


def test_files_that_cannot_be_read_are_named(scene, tmp_path):
    add_quad(scene)
    (tmp_path / "broken.vdb").write_bytes(b"no volume at all")
    smoke = add_file(scene, tmp_path / "missing.vdb")
    for name in ("missing.vdb", "broken.vdb"):
        smoke.data.filepath = str(tmp_path / name)
        bpy.context.view_layer.update()
        [warning] = [warning for warning in exported(scene)["warnings"] if "'Smoke'" in warning]
        assert "its file cannot be read" in warning and "left out" in warning, warning
    write_vdb(tmp_path / "heat.vdb", {"heat": np.ones((4, 4, 4))})
    smoke.data.filepath = str(tmp_path / "heat.vdb")
    [warning] = [warning for warning in exported(scene)["warnings"] if "'Smoke'" in warning]
    assert "asks for grids 'color', 'density' and 'temperature', and it has 'heat'" in warning, warning


def test_densities_that_are_no_numbers_or_below_0_are_0(scene, tmp_path):
    density = np.ones((4, 4, 4), np.float32)
    density[1, 1, 1], density[2, 2, 2] = math.nan, -1.0
    write_vdb(tmp_path / "smoke.vdb", {"density": density})
    add_file(scene, tmp_path / "smoke.vdb")
    found, instance, _ = fog_of(scene)
    values = found.grid_values(
        instance["grids"], "density", volumes.SHIFT + np.array([[1, 1, 1], [2, 2, 2], [3, 3, 3]], np.float32)
    )
    assert values[:, 0].tolist() == [0.0, 0.0, 1.0]
    [warning] = [warning for warning in found.warnings if "'Smoke'" in warning]
    assert "1 values of grid 'density' are not finite numbers; taken as 0" in warning, warning


class FakeGrid(list):
    """Numbers as a simulation gives them."""

    def foreach_get(self, array):
        """Copies them."""
        array[:] = self


def add_smoke(scene, monkeypatch, density, color):
    """A smoke domain with arrays [x, y, z] and [x, y, z, 4] of a simulation, of which Blender's module has none."""
    mesh = bpy.data.meshes.new("Domain")
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    mesh.from_pydata(corners, [], [(0, 1, 3, 2), (4, 6, 7, 5)])
    mesh.materials.append(smoke(color_attribute="color")[0])
    domain = SimpleNamespace(
        cache_frame_start=1,
        cache_frame_end=4,
        clipping=1e-6,
        use_noise=False,
        noise_scale=2,
        domain_resolution=density.shape,
        density_grid=FakeGrid(density.transpose(2, 1, 0).ravel()),
        color_grid=FakeGrid(color.transpose(2, 1, 0, 3).ravel()),
        temperature_grid=FakeGrid(),
    )
    monkeypatch.setattr(volumes, "smoke_domain", lambda obj: domain if obj.name == "Domain" else None)
    monkeypatch.setattr(export_of_scenes, "smoke_domain", volumes.smoke_domain)
    return add(scene, "Domain", mesh), domain


def test_smoke_fills_the_texture_space_of_its_domain(scene, monkeypatch):
    density = np.random.default_rng(1).uniform(0.5, 2.0, (6, 5, 4))
    shown = np.random.default_rng(2).uniform(0.1, 1.0, (6, 5, 4, 3))
    color = np.concatenate([shown * density[..., None], density[..., None]], axis=-1)
    add_smoke(scene, monkeypatch, density, color)
    found, instance, grids = fog_of(scene)
    assert sorted((grid["name"], grid["channels"]) for grid in grids) == [("color", 4), ("density", 1)]
    voxels = np.array(list(np.ndindex(density.shape)))
    centres = (-1.0 + (voxels + 0.5) * 2.0 / np.array(density.shape)).astype(np.float32)
    values = found.grid_values(instance["grids"], "density", centres)
    np.testing.assert_allclose(values[:, 0], density.ravel(), rtol=1e-4)
    values = found.grid_values(instance["grids"], "color", centres)
    np.testing.assert_allclose(values, shown.reshape(-1, 3), rtol=1e-4)


def test_smoke_is_there_in_the_frames_of_its_cache(scene, monkeypatch):
    add_quad(scene)
    _, domain = add_smoke(scene, monkeypatch, np.ones((4, 4, 4)), np.ones((4, 4, 4, 4)))
    for frame, is_there in ((1, True), (4, True), (5, False)):
        scene.frame_set(frame)
        assert bool(exported(scene)["grids"]) == is_there, frame
    domain.density_grid.clear()
    domain.color_grid.clear()
    scene.frame_set(2)
    assert not exported(scene)["grids"]


def test_a_view_layer_without_volumes_has_none(scene, tmp_path):
    add_quad(scene)
    write_vdb(tmp_path / "smoke.vdb", {"density": np.ones((4, 4, 4))})
    add_file(scene, tmp_path / "smoke.vdb")
    assert len(exported(scene)["grids"]) == 1
    bpy.context.view_layer.use_volumes = False
    assert not exported(scene)["grids"]
