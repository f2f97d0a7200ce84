"""Hair and points as Cycles shows them: curves of every shape, particle hair, point clouds."""

import math

import bpy
import numpy as np
import pytest

from helpers import add_quad, exported
from strands import add_cloud, add_strands, assert_like_cycles, bent_strands, diffuse, look, meadow, straighten

pytestmark = pytest.mark.every_version

RIBBON, ROUND = {"ribbon": {"subdivisions": 2}}, "round"


@pytest.mark.parametrize("shape", ["RIBBONS", "THICK"])
def test_diffuse_strands_look_as_in_cycles(scene, tmp_path, shape):
    add_strands(scene, bent_strands(), np.linspace(0.05, 0.01, 5), diffuse())
    scene.cycles_curves.shape = shape
    look(scene)
    assert_like_cycles(scene, tmp_path)


def test_poly_curves_are_splines_before_blender_5_and_cones_from_then_on(scene, tmp_path):
    zigzag = np.array([[(x, 0.4 * (-1) ** k, 0.0) for k, x in enumerate(np.linspace(-1.2, 1.2, 7))]])
    straighten(add_strands(scene, zigzag, 0.08, diffuse()))
    look(scene)
    shape = exported(scene)["curves"][0]["shape"]
    assert shape == (RIBBON if bpy.app.version < (5, 0) else "linear")
    assert_like_cycles(scene, tmp_path)


@pytest.mark.parametrize("shape", ["RIBBONS", "THICK"])
def test_particle_hair_with_children_looks_as_in_cycles(scene, tmp_path, shape):
    meadow(scene, count=30, brownian_factor=0.2, child_type="INTERPOLATED", rendered_child_count=4)
    scene.cycles_curves.shape = shape
    look(scene)
    (hair,) = exported(scene)["curves"]
    assert hair["curves"] == 120 and hair["keys"] == 120 * 9 and hair["uv_maps"] == ["UVMap"]
    assert_like_cycles(scene, tmp_path)


def test_a_point_cloud_looks_as_in_cycles(scene, tmp_path):
    add_cloud(scene, np.random.default_rng(2).uniform(-1.2, 1.2, (50, 3)), np.linspace(0.05, 0.3, 50), diffuse())
    look(scene)
    assert_like_cycles(scene, tmp_path)


@pytest.mark.parametrize("mode", ["EDIT", "PARTICLE_EDIT"])
def test_particle_hair_that_cycles_hides_while_it_is_edited_is_named(scene, mode):
    ground = meadow(scene)
    bpy.context.view_layer.objects.active = ground
    bpy.ops.object.mode_set(mode=mode)
    found = exported(scene)
    assert found["curves"] == []
    (warning,) = found["warnings"]
    assert warning.startswith("object 'Meadow': its particle hair is left out while it is edited, as by Cycles")
    bpy.ops.object.mode_set(mode="OBJECT")
    assert len(exported(scene)["curves"]) == 1


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT_CURVES"])
def test_hair_curves_that_are_edited_are_read_as_they_are_shown(scene, mode):
    fur = add_strands(scene, bent_strands(), 0.01)
    bpy.context.view_layer.objects.active = fur
    fur.data.surface = add_quad(scene)
    bpy.ops.object.mode_set(mode=mode)
    fur.data.attributes["radius"].data.foreach_set("value", np.full(200, 0.02, np.float32))
    fur.data.update_tag()
    (hair,) = exported(scene)["curves"]
    assert hair["curves"] == 40 and hair["radii"] == pytest.approx([0.02, 0.02])


def test_hair_hidden_by_the_view_layer_is_left_out(scene):
    meadow(scene)
    add_strands(scene, bent_strands(), 0.01)
    assert len(exported(scene)["curves"]) == 2
    bpy.context.view_layer.use_strand = False
    assert exported(scene)["curves"] == []


def test_a_layer_without_surfaces_shows_hair_alone(scene):
    meadow(scene)
    add_strands(scene, bent_strands(), 0.01)
    bpy.context.view_layer.use_solid = False
    found = exported(scene)
    assert len(found["curves"]) == 2 and found["meshes"] == []


def test_keys_without_radius_have_that_of_cycles(scene):
    fur = add_strands(scene, bent_strands())
    if "radius" in fur.data.attributes:
        fur.data.attributes.remove(fur.data.attributes["radius"])
    assert exported(scene)["curves"][0]["radii"] == pytest.approx([0.005, 0.005])


def test_bad_strands_are_named_and_the_others_stay(scene):
    keys = bent_strands()
    keys[3, 2, 1] = math.nan
    add_strands(scene, keys, 0.01)
    found = exported(scene)
    assert found["curves"][0]["curves"] == 40
    assert found["warnings"] == ["object 'Fur': 1 strands with keys that are no numbers are left out"]


def test_strands_without_thickness_are_named(scene):
    add_strands(scene, bent_strands(), 0.0)
    (warning,) = exported(scene)["warnings"]
    assert "no thickness" in warning
