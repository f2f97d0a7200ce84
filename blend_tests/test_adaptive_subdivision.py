"""Objects with adaptive subdivision, as Cycles shows them."""

import json
import math

import bpy
import numpy as np
import pytest
import relume

import cards as cards_module
from addon.engine.reading.scene import load_scene
from addon.engine.staleness import fingerprints
from addon.export import trace_settings
from cards import Cards, differing_pixels, node
from helpers import add_material, render_cycles, update

OF_MODIFIER = bpy.app.version >= (5, 0, 0)
"""True where the modifier itself has the settings."""


@pytest.fixture
def cards(scene, monkeypatch):
    monkeypatch.setattr(cards_module, "PIXELS", 16)
    return Cards(scene, columns=4)


def cage(name, columns=3):
    """A crumpled square of quads and two triangles, with a UV map and colours."""
    mesh = bpy.data.meshes.new(name)
    side = [i / columns - 0.5 for i in range(columns + 1)]
    points = [(x, y, 0.08 * ((i + j) % 2)) for j, y in enumerate(side) for i, x in enumerate(side)]
    up = columns + 1
    faces = [(i, i + 1, i + up + 1, i + up) for j in range(columns) for i in range(j * up, j * up + columns)]
    a, b, c, d = faces[columns]
    faces[columns : columns + 1] = [(a, b, c), (a, c, d)]
    mesh.from_pydata(points, [], faces)
    coords = [[points[loop.vertex_index][axis] + 0.5 for axis in (0, 1)] for loop in mesh.loops]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.ravel(coords))
    colors = np.random.default_rng(3).random((len(mesh.loops), 4)).astype(np.float32)
    mesh.color_attributes.new("Col", "FLOAT_COLOR", "CORNER").data.foreach_set("color", colors.ravel())
    return mesh


def subdivide(obj, kind="CATMULL_CLARK", pixels=0.5, smooth=True, levels=1, **settings):
    """Gives an object adaptive subdivision to edges of so many pixels."""
    obj.data.polygons.foreach_set("use_smooth", [smooth] * len(obj.data.polygons))
    modifier = obj.modifiers.new("Subdivision", "SUBSURF")
    modifier.subdivision_type, modifier.levels, modifier.render_levels = kind, levels, levels
    if OF_MODIFIER:
        modifier.use_adaptive_subdivision, modifier.adaptive_pixel_size = True, pixels
    else:
        bpy.context.scene.cycles.feature_set, obj.cycles.use_adaptive_subdivision = "EXPERIMENTAL", True
        obj.cycles.dicing_rate = pixels
    for key, value in settings.items():
        setattr(modifier, key, value)
    return modifier


def look(tree, vector="Normal"):
    """A vector at a point of the surface, as a colour."""
    kind = "ShaderNodeTexCoord" if vector in {"UV", "Generated"} else "ShaderNodeNewGeometry"
    found = node(tree, kind).outputs[vector]
    half = (0.5, 0.5, 0.5)
    return node(tree, "ShaderNodeVectorMath", {0: found, 1: half, 2: half}, operation="MULTIPLY_ADD").outputs[0]


def height(tree):
    """A displacement by a wave over the card."""
    wave = node(tree, "ShaderNodeTexWave", {"Vector": node(tree, "ShaderNodeTexCoord").outputs["UV"], "Scale": 0.6})
    inputs = {"Height": wave.outputs["Fac"], "Midlevel": 0.25, "Scale": 0.08}
    return node(tree, "ShaderNodeDisplacement", inputs).outputs[0]


def add(cards, name, shown=look, offset=None, method="DISPLACEMENT", **settings):
    """A card with adaptive subdivision; returns its object."""
    tree, output = cards.add(name)
    card, material = cards.scene.objects[name], bpy.data.materials[name]
    card.data = cage(name)
    card.data.materials.append(material)
    material.cycles.emission_sampling = "NONE"
    cards.show(tree, output, shown(tree))
    if offset is not None:
        material.displacement_method = method
        tree.links.new(offset(tree), output.inputs["Displacement"])
    subdivide(card, **settings)
    return card


def summary(scene):
    return json.loads(load_scene(scene).summary())


def triangles(scene, name="Diced"):
    found = summary(scene)
    return next(found["meshes"][each["mesh"]]["triangles"] for each in found["instances"] if each["name"] == name)


def test_smooth_surfaces_and_their_attributes_are_those_of_cycles(cards, tmp_path):
    for vector in ("Normal", "UV", "Generated"):
        add(cards, vector, lambda tree, vector=vector: look(tree, vector))
    add(cards, "colour", lambda tree: node(tree, "ShaderNodeVertexColor").outputs[0])
    add(cards, "flat", smooth=False)
    add(cards, "linear", kind="SIMPLE")
    add(cards, "linear flat", kind="SIMPLE", smooth=False)
    # Normals at a crease are those of either side.
    creased = add(cards, "creased", lambda tree: look(tree, "Position"))
    weights = np.resize([0.0, 1.0, 0.15], len(creased.data.edges)).astype(np.float32)
    creased.data.attributes.new("crease_edge", "FLOAT", "EDGE").data.foreach_set("value", weights)
    assert differing_pixels(cards, tmp_path) == ({}, [])


def test_maps_are_smooth_as_the_modifier_says(cards, tmp_path):
    for how in ("NONE", "PRESERVE_CORNERS", "PRESERVE_BOUNDARIES", "SMOOTH_ALL"):
        add(cards, how, lambda tree: look(tree, "UV"), uv_smooth=how)
    assert differing_pixels(cards, tmp_path) == ({}, [])


def test_diced_faces_are_displaced_as_in_cycles(cards, tmp_path):
    for kind in ("CATMULL_CLARK", "SIMPLE"):
        add(cards, kind, offset=height, kind=kind)
        if bpy.app.version >= (4, 5, 0) or kind == "SIMPLE":
            add(cards, f"{kind} bumped", offset=height, method="BOTH", kind=kind)
    assert differing_pixels(cards, tmp_path) == ({}, [])


@pytest.mark.skipif(not OF_MODIFIER, reason="the modifier knows pixels only")
def test_edges_in_object_space_are_as_long_as_asked_for(scene):
    add_diced(scene, "SIMPLE", adaptive_space="OBJECT", adaptive_object_edge_length=0.1)
    # A quad of 4 m: halves of 4 m down to an eighth, which is nearer to .1 m than a sixteenth.
    assert triangles(scene) == 2 * 32**2
    scene.cycles.dicing_rate = 2.0
    assert triangles(scene) == 2 * 16**2


def add_diced(scene, kind="CATMULL_CLARK", size=4.0, **settings):
    """A square with adaptive subdivision, in front of a perspective camera or below it."""
    mesh = bpy.data.meshes.new("Diced")
    half = size / 2
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    obj = bpy.data.objects.new("Diced", mesh)
    scene.collection.objects.link(obj)
    subdivide(obj, kind, **{"pixels": 1.0, **settings})
    update()
    return obj


def look_down(scene, height=5.0, pixels=64):
    """An orthographic view of 8 m from above."""
    camera, render = scene.camera, scene.render
    camera.data.type, camera.data.ortho_scale = "ORTHO", 8.0
    camera.location, camera.rotation_euler = (0.0, 0.0, height), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = pixels
    update()


def test_triangles_follow_pixels_rates_limits_and_the_dicing_camera(scene):
    add_diced(scene, "SIMPLE", levels=0)
    look_down(scene)
    assert triangles(scene) == 2 * 32**2  # 4 m are 32 pixels.
    scene.cycles.dicing_rate = 4.0
    assert triangles(scene) == 2 * 8**2
    scene.cycles.dicing_rate, scene.cycles.max_subdivisions = 1.0, 3
    assert triangles(scene) == 2 * 8**2
    scene.cycles.max_subdivisions = 12
    nearer = scene.camera.copy()
    nearer.data = scene.camera.data.copy()
    nearer.data.ortho_scale = 4.0
    scene.collection.objects.link(nearer)
    scene.cycles.dicing_camera = nearer
    assert triangles(scene) == 2 * 64**2
    nearer.location.x = 100.0
    update()
    assert triangles(scene) < 2 * 8**2
    scene.cycles.offscreen_dicing_scale = 1.0
    assert triangles(scene) == 2 * 64**2


def test_the_modifier_stays_as_it_was(scene):
    obj = add_diced(scene)
    before = [(modifier.name, modifier.show_render) for modifier in obj.modifiers]
    summary(scene)
    assert [(modifier.name, modifier.show_render) for modifier in obj.modifiers] == before
    assert len(obj.data.polygons) == 1


def test_what_dices_a_mesh_is_noticed_as_changed(scene):
    obj = add_diced(scene)
    viewer = scene.camera.copy()
    scene.collection.objects.link(viewer)

    def finer():
        if OF_MODIFIER:
            obj.modifiers[0].adaptive_pixel_size = 0.5
        else:
            obj.cycles.dicing_rate = 0.5

    for key, edit in {
        "settings": lambda: setattr(scene.cycles, "dicing_rate", 2.0),
        "settings camera": lambda: setattr(scene.cycles, "dicing_camera", viewer),
        "settings place": lambda: setattr(viewer, "location", (1.0, 2.0, 3.0)),
        "object Diced": finer,
    }.items():
        kind = key if key.startswith("object") else "settings"
        before = fingerprints.all_fingerprints(scene, scene.camera)[kind]
        edit()
        update()
        assert fingerprints.all_fingerprints(scene, scene.camera)[kind] != before, key
    assert "settings" in fingerprints.keys_of_block(viewer, scene)
    obj.modifiers.clear()
    update()
    assert "dicing" not in fingerprints.all_fingerprints(scene, scene.camera)["settings"]


def test_a_plane_in_waves_to_the_horizon_is_that_of_cycles(scene, tmp_path):
    obj = add_diced(scene, "SIMPLE", size=200.0)
    material, tree, output = add_material("Waves")
    obj.data.materials.append(material)
    emission = node(tree, "ShaderNodeEmission", {"Color": look(tree)})
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    place = node(tree, "ShaderNodeTexCoord").outputs["Object"]
    wave = node(tree, "ShaderNodeTexWave", {"Vector": place, "Scale": 0.1}).outputs["Fac"]
    inputs = {"Height": wave, "Midlevel": 0.5, "Scale": 1.0}
    tree.links.new(node(tree, "ShaderNodeDisplacement", inputs).outputs[0], output.inputs["Displacement"])
    material.displacement_method, material.cycles.emission_sampling = "DISPLACEMENT", "NONE"
    camera, render = scene.camera, scene.render
    camera.location, camera.rotation_euler = (0.0, -20.0, 3.0), (math.radians(84.0), 0.0, 0.0)
    render.resolution_x, render.resolution_y = 48, 32
    update()
    loaded = load_scene(scene)
    settings = trace_settings(scene, lambda _: None) | {"samples": 64}
    relume.bake(loaded, tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight(loaded.lights(), denoise=False)["combined"][::-1]
    cycles = render_cycles(scene, samples=64)
    blocks = [image[..., :3].reshape(8, 4, 12, 4, 3).mean(axis=(1, 3)) for image in (ours, cycles)]
    difference = np.abs(blocks[0] - blocks[1])
    assert loaded.warnings == []
    assert difference.mean() < 0.005 and difference.max() < 0.05, (difference.mean(), difference.max())
