"""Bodies that light scatters in, as Relume and as Cycles see them."""

import math

import bpy
import numpy as np
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from cards import node
from helpers import add, add_light, add_material, render_cycles

PIXELS = 16
"""Pixels along a picture's side."""


def body_material(name, kind="ShaderNodeSubsurfaceScattering", method=None, bump=False, **inputs):
    """A material of one node with subsurface scattering; inputs by socket name."""
    material, tree, output = add_material(name)
    settings = {}
    if method is not None:
        settings["falloff" if kind == "ShaderNodeSubsurfaceScattering" else "subsurface_method"] = method
    shader = node(tree, kind, inputs, **settings)
    if bump:
        noise = node(tree, "ShaderNodeTexNoise", {"Scale": 3.0})
        bumps = node(tree, "ShaderNodeBump", {"Height": noise.outputs[0], "Strength": 1.0})
        tree.links.new(bumps.outputs[0], shader.inputs["Normal"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return material


def add_box(scene, name, low, high, material):
    """A box between two corners."""
    corners = [(x, y, z) for z in (low[2], high[2]) for y in (low[1], high[1]) for x in (low[0], high[0])]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], faces)
    mesh.materials.append(material)
    return add(scene, name, mesh)


def add_ball(scene, name, material, radius=1.0):
    """A smooth sphere at the origin."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24, radius=radius)
    ball = bpy.context.object
    ball.name = name
    ball.data.materials.append(material)
    for polygon in ball.data.polygons:
        polygon.use_smooth = True
    return ball


def half_lit(scene, material):
    """A thick slab under a lamp that stands over its left half alone."""
    add_box(scene, "Slab", (-1.0, -1.0, -1.0), (1.0, 1.0, 0.0), material)
    add_light(scene, "AREA", "Half", (-0.5, 0.0, 0.05), energy=20.0, shape="RECTANGLE", size=1.0, size_y=2.0)
    look(scene, 0.5)


def lit_from_behind(scene, material, thickness=0.05):
    """A slab above a lamp."""
    add_box(scene, "Slab", (-1.0, -1.0, -thickness), (1.0, 1.0, 0.0), material)
    lamp = add_light(scene, "AREA", "Behind", (0.0, 0.0, -0.3), energy=50.0, size=1.0)
    lamp.rotation_euler = (math.pi, 0.0, 0.0)
    look(scene, 0.5)


def corner(scene, material):
    """A floor and a wall, two bodies that light each other, under a lamp."""
    add_box(scene, "Floor", (-1.0, -1.0, -0.5), (1.0, 1.0, 0.0), material)
    add_box(scene, "Wall", (0.05, -1.0, 0.0), (1.0, 1.0, 1.0), material)
    lamp = add_light(scene, "AREA", "Key", (-1.0, 0.0, 1.0), energy=20.0, size=1.0)
    lamp.rotation_euler = (0.0, math.radians(-45.0), 0.0)
    look(scene, 0.4, at=(-0.2, 0.0))


def ball(scene, material):
    """A ball beside a lamp."""
    add_ball(scene, "Ball", material, radius=0.5)
    add_light(scene, "AREA", "Key", (0.5, -0.5, 2.0), energy=40.0, size=1.0)
    look(scene, 1.1)


def look(scene, size, at=(0.0, 0.0)):
    """An orthographic view from above."""
    camera, render, cycles = scene.camera, scene.render, scene.cycles
    camera.data.type, camera.data.ortho_scale = "ORTHO", size
    camera.location, camera.rotation_euler = (*at, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = PIXELS
    cycles.pixel_filter_type, cycles.blur_glossy = "BOX", 0.0
    scene.world = scene.world or bpy.data.worlds.new("Black")
    scene.world.color = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()


def pictures(scene, folder, samples, cycles_samples=None, settings=None):
    """Pictures of Relume and of Cycles, and Relume's warnings."""
    read = load_scene(scene)
    own = trace_settings(scene, lambda _: None) | {"samples": samples} | (settings or {})
    relume.bake(read, folder, own).wait()
    ours = relume.Relighter(folder).relight(read.lights(), denoise=False)["combined"][::-1]
    return np.array(ours), render_cycles(scene, samples=cycles_samples or samples), read.warnings


def columns(image):
    """Means of pairs of columns, with their standard errors, [pairs, 3] each. All rows have to look alike."""
    pairs = image.reshape(PIXELS, PIXELS // 2, 2, 3).transpose(1, 0, 2, 3).reshape(PIXELS // 2, -1, 3)
    return pairs.mean(axis=1), pairs.std(axis=1, ddof=1) / math.sqrt(pairs.shape[1])
