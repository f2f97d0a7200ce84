"""Point Density beside Cycles: Blender has the node up to 4.5."""

import bpy
import numpy as np
import pytest
from test_media import assert_equal_to_cycles, cube, fill, stage

from addon.engine.staleness.world_fingerprints import space
from cards import node
from helpers import add, add_material, add_quad, exported, render_cycles

__all__ = ["stage"]

pytestmark = [
    pytest.mark.every_version,
    pytest.mark.skipif(bpy.app.version >= (5, 0, 0), reason="the node is gone"),
]
PLACES = [(-0.5, -0.2, 0.8), (0.3, 0.1, 1.4), (0.1, 0.5, 0.9), (0.2, -0.4, 1.2)]


@pytest.fixture
def points(stage):
    """An object of a few vertices with colours, turned and scaled."""
    mesh = bpy.data.meshes.new("Points")
    mesh.from_pydata(PLACES, [(0, 1), (2, 3)], [])
    colors = mesh.color_attributes.new("Tint", "FLOAT_COLOR", "POINT")
    colors.data.foreach_set(
        "color", np.array([(1, 0.1, 0.1, 1), (0.2, 1, 0.3, 1), (0.1, 0.4, 1, 1), (1, 1, 1, 1)]).ravel()
    )
    obj = add(stage, "Points", mesh)
    obj.rotation_euler, obj.scale = (0.1, 0.2, 0.4), (1.2, 0.8, 1.0)
    obj.hide_render = True
    return obj


def density(tree, obj, **settings):
    """The node, of an object's vertices."""
    settings = {"point_source": "OBJECT", "object": obj, "radius": 0.6, "resolution": 20} | settings
    return node(tree, "ShaderNodeTexPointDensity", **settings)


def smoke(target, obj, gain=5.0, colored=False, vector=None, **settings):
    """Fills a mesh with what the node gives; its colour too if `colored`."""
    tree, output = fill(target)
    texture = density(tree, obj, **settings)
    if vector is not None:
        tree.links.new(vector(tree), texture.inputs["Vector"])
    thick = node(tree, "ShaderNodeMath", {0: texture.outputs["Density"], 1: gain}, operation="MULTIPLY")
    scatter = node(tree, "ShaderNodeVolumeScatter", {"Density": thick.outputs[0]})
    if colored:
        tree.links.new(texture.outputs["Color"], scatter.inputs["Color"])
    tree.links.new(scatter.outputs[0], output.inputs["Volume"])
    return texture


def raised(tree):
    """A position other than that of the shaded point."""
    place = node(tree, "ShaderNodeNewGeometry").outputs["Position"]
    return node(tree, "ShaderNodeVectorMath", {0: place, 1: (0.1, 0.0, 0.3)}, operation="ADD").outputs[0]


CASES = {
    "world": {"space": "WORLD"},
    "object": {"space": "OBJECT"},
    "closest": {"space": "WORLD", "interpolation": "Closest", "resolution": 7},
    "cubic": {"space": "WORLD", "interpolation": "Cubic", "resolution": 9},
    "colours": {"space": "WORLD", "colored": True, "vertex_color_source": "VERTEX_COLOR"},
    "another place": {"space": "WORLD", "vector": raised},
    "another place of the object": {"space": "OBJECT", "vector": raised},
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_vertices_of_an_object_as_smoke(points, stage, tmp_path, case):
    settings = dict(CASES[case])
    if "vertex_color_source" in settings:
        settings["vertex_attribute_name"] = "Tint"
    smoke(cube(), points, **settings)
    assert_equal_to_cycles(stage, tmp_path)


@pytest.mark.slow
def test_particles_as_smoke(points, stage, tmp_path):
    emitter = add_quad(stage, "Emitter", size=1.0)
    emitter.location, emitter.hide_render = (0.0, 0.0, 0.7), True
    emitter.modifiers.new("Particles", "PARTICLE_SYSTEM")
    particles = emitter.particle_systems[0]
    particles.settings.count, particles.settings.frame_start, particles.settings.frame_end = 30, 1, 5
    stage.frame_set(10)
    smoke(
        cube(),
        emitter,
        space="WORLD",
        point_source="PARTICLE_SYSTEM",
        particle_system=particles,
        particle_color_source="PARTICLE_AGE",
        colored=True,
    )
    assert_equal_to_cycles(stage, tmp_path)


@pytest.mark.slow
def test_simplify_halves_the_image(points, stage, tmp_path):
    smoke(cube(), points, space="WORLD", resolution=131, radius=0.3)
    stage.render.use_simplify, stage.cycles.texture_limit_render = True, "128"
    assert_equal_to_cycles(stage, tmp_path)


def test_surfaces_do_not_see_it(points, stage):
    material, tree, output = add_material("Glow")
    texture = density(tree, points, space="WORLD")
    emission = node(tree, "ShaderNodeEmission", {"Strength": texture.outputs["Density"]})
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    add_quad(stage, "Glow", material=material).location.z = 1.0
    bpy.data.objects.remove(bpy.data.objects["Lamp"], do_unlink=True)
    assert np.all(render_cycles(stage, samples=4) == 0.0)
    found = exported(stage)
    assert found["warnings"] == []
    glow = next(each for each in found["materials"] if each["name"] == "Glow")
    emission = next(each for each in glow["nodes"] if each["type"] == "emission")
    assert emission["strength"] == 0.0


def test_too_many_voxels_are_named(points, stage):
    smoke(cube(), points, space="WORLD", resolution=300)
    [message] = exported(stage)["warnings"]
    assert "'Point Density'" in message and "256" in message


def test_a_world_full_of_it_has_a_fingerprint_of_its_own(points, stage):
    stage.world.use_nodes = True
    tree = stage.world.node_tree
    texture = density(tree, points, space="WORLD")
    scatter = node(tree, "ShaderNodeVolumeScatter", {"Density": texture.outputs["Density"]})
    tree.links.new(scatter.outputs[0], tree.nodes["World Output"].inputs["Volume"])
    before = space(stage)
    assert space(stage) == before
    texture.radius = 0.2
    assert space(stage) != before
