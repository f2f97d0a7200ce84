"""Subsurface scattering: what each version means by it, and pictures compared with Cycles'."""

import math

import bpy
import numpy as np
import pytest

from addon.export.materials.subsurface import model
from bodies import PIXELS, add_box, ball, body_material, columns, corner, half_lit, lit_from_behind, pictures
from cards import node
from helpers import add_material, add_quad, exported

pytestmark = pytest.mark.every_version

SKIN = {"Color": (0.8, 0.5, 0.3, 1.0), "Radius": (1.0, 0.2, 0.1)}
HAS_LEGACY = bpy.app.version >= (5, 2, 0)
LEGACY = "RANDOM_WALK_LEGACY" if HAS_LEGACY else "RANDOM_WALK"
METHODS = ["BURLEY", "RANDOM_WALK", "RANDOM_WALK_SKIN", *(["RANDOM_WALK_LEGACY"] if HAS_LEGACY else [])]


def assert_alike(ours, cycles):
    """Asserts that means of columns are alike to within three standard errors and half a percent."""
    (a, error_a), (b, error_b) = columns(ours), columns(cycles)
    allowed = 3.0 * np.hypot(error_a, error_b) + 0.005 * np.abs(b)
    assert (np.abs(a - b) <= allowed).mean() > 0.95, (a.round(4).tolist(), b.round(4).tolist())
    # All together are far less noisy.
    error = np.hypot(np.linalg.norm(error_a, axis=0), np.linalg.norm(error_b, axis=0)) / len(a)
    total = np.abs(a.mean(axis=0) - b.mean(axis=0))
    assert (total <= 3.0 * error + 0.01 * b.mean(axis=0)).all(), (a.mean(axis=0), b.mean(axis=0), error)


@pytest.mark.parametrize("method", METHODS)
def test_the_edge_of_light_is_as_soft_as_in_cycles(scene, tmp_path, method):
    is_true_radius = method == "RANDOM_WALK" and HAS_LEGACY
    half_lit(scene, body_material("Body", method=method, Scale=0.05 if is_true_radius else 0.5, **SKIN))
    ours, cycles, warnings = pictures(scene, tmp_path / "bake", 256)
    assert warnings == []
    assert_alike(ours, cycles)
    # Red reaches farther into the shadow than blue.
    shadow = columns(ours)[0][6]
    assert shadow[0] / 0.8 > 2.0 * shadow[2] / 0.3


@pytest.mark.parametrize("anisotropy", [0.8, -0.5])
def test_light_from_behind_comes_through_as_in_cycles(scene, tmp_path, anisotropy):
    material = body_material(
        "Body",
        method=LEGACY if anisotropy > 0 else "RANDOM_WALK",
        Scale=0.5 if anisotropy > 0 or not HAS_LEGACY else 0.05,
        Anisotropy=anisotropy,
        **SKIN,
    )
    lit_from_behind(scene, material)
    ours, cycles, _ = pictures(scene, tmp_path / "bake", 512)
    assert cycles.mean() > 0.01
    assert_alike(ours, cycles)


def test_a_body_that_reaches_out_of_fog_is_lit_from_outside_as_in_cycles(scene, tmp_path):
    lit_from_behind(scene, body_material("Body", method=LEGACY, Scale=0.5, **SKIN))
    fog, tree, output = add_material("Fog")
    absorbing = node(tree, "ShaderNodeVolumeAbsorption", {"Color": (0.5, 0.5, 0.5, 1.0), "Density": 6.0})
    tree.links.new(absorbing.outputs[0], output.inputs["Volume"])
    # It begins in the middle of the slab: rays of the camera are in it, and those on to the lamp are not.
    add_box(scene, "Fog", (-0.9, -0.9, -0.025), (0.9, 0.9, 0.3), fog)
    # A floor behind the lamp, so that no ray leaves the scene.
    black = body_material("Black", "ShaderNodeEmission", Strength=0.0)
    add_quad(scene, "Floor", size=8.0, material=black).location.z = -0.6
    ours, cycles, warnings = pictures(scene, tmp_path / "bake", 512)
    assert warnings == []
    assert cycles.mean() > 0.01
    assert_alike(ours, cycles)


def test_bodies_light_each_other_as_in_cycles(scene, tmp_path):
    corner(scene, body_material("Body", method=LEGACY, Scale=0.2, **SKIN))
    ours, cycles, _ = pictures(scene, tmp_path / "bake", 512)
    assert_alike(ours, cycles)


@pytest.mark.parametrize("bump", [False, True])
def test_a_principled_ball_is_as_bright_as_in_cycles(scene, tmp_path, bump):
    inputs = {"Base Color": SKIN["Color"], "Subsurface Radius": SKIN["Radius"], "Subsurface Scale": 0.05}
    kind = "ShaderNodeBsdfPrincipled"
    ball(scene, body_material("Body", kind, bump=bump, **{"Subsurface Weight": 0.8, "Roughness": 0.4, **inputs}))
    pairs = []
    for seed in (1, 2):
        scene.cycles.seed = seed
        pairs.append(pictures(scene, tmp_path / f"bake {seed}", 256, settings={"seed": seed})[:2])
    first, second = np.array(pairs[0]), np.array(pairs[1])
    ours, cycles = (0.5 * (first + second)).mean(axis=(1, 2))
    # Standard errors of means of two pictures, from how these differ.
    errors = (first - second).std(axis=(1, 2)) / (2.0 * PIXELS)
    allowed = 3.0 * np.hypot(*errors) + 0.005 * cycles
    assert (np.abs(ours - cycles) <= allowed).all(), (ours, cycles, errors)


@pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="thin walls are new in Blender 5.2")
def test_a_thin_sheet_is_as_bright_as_in_cycles(scene, tmp_path):
    inputs = {"Base Color": SKIN["Color"], "Subsurface Weight": 1.0, "Subsurface Anisotropy": 0.4, "Thin Wall": True}
    material = body_material("Body", "ShaderNodeBsdfPrincipled", **inputs, **{"Specular IOR Level": 0.0})
    lit_from_behind(scene, material)
    scene.collection.objects.unlink(scene.objects["Slab"])
    add_quad(scene, "Sheet", material=material)
    ours, cycles, warnings = pictures(scene, tmp_path / "bake", 256)
    assert warnings == []
    assert_alike(ours, cycles)


def test_methods_mean_what_this_version_means():
    by_method = {method: model(method) for method in METHODS}
    small = 0.25 / math.pi
    assert by_method["BURLEY"]["method"] == "disk" and by_method["BURLEY"]["radius_factor"] == pytest.approx(small)
    assert by_method["RANDOM_WALK_SKIN"]["method"] == "skin" and by_method["RANDOM_WALK_SKIN"]["radius_factor"] == 1.0
    assert by_method[LEGACY]["radius_factor"] == pytest.approx(small)
    assert by_method[LEGACY]["inversion"] == by_method["RANDOM_WALK_SKIN"]["inversion"] == "polynomial"
    if HAS_LEGACY:
        assert by_method["RANDOM_WALK"]["inversion"] == "van_de_hulst"
        assert by_method["RANDOM_WALK"]["radius_factor"] == 1.0
    walks_again = bpy.app.version >= (5, 0, 0)
    assert by_method[LEGACY]["is_first_only"] is not walks_again
    assert by_method["BURLEY"]["is_first_only"]


def test_both_nodes_say_what_they_scatter(scene):
    add_quad(scene, "A", material=body_material("A", Scale=0.3, **SKIN))
    inputs = {"Subsurface Weight": 0.5, "Subsurface Scale": 0.3}
    add_quad(scene, "B", material=body_material("B", "ShaderNodeBsdfPrincipled", **inputs))
    add_quad(scene, "C", material=body_material("C", "ShaderNodeBsdfPrincipled"))
    summary = exported(scene)
    assert summary["warnings"] == []
    nodes = {material["name"]: material["nodes"][material["surface"]] for material in summary["materials"]}
    assert nodes["A"]["type"] == "subsurface_scattering"
    for name in "AB":
        assert nodes[name]["subsurface"]["scale"] == pytest.approx(0.3)
    assert "subsurface" not in nodes["C"]
