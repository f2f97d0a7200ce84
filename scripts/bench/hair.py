"""A head of hair under a lamp and a sky. Needs `bpy`."""

import sys
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "blend_tests"))
from helpers import add_light, add_material, add_world  # noqa: E402

STRANDS, KEYS = 20_000, 11
RADIUS, LENGTH, THICKNESS = 0.1, 0.15, 4e-5
"""Of the head, its hair and a single hair, metres."""


def strands(count, seed=0):
    """Keys of hairs on the upper half of a sphere, combed down and curled, [count, KEYS, 3]."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(count, 3))
    root[:, 2] = np.abs(root[:, 2])
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    share = np.linspace(0.0, 1.0, KEYS)[None, :, None]
    down = np.array([0.0, 0.0, -1.0])
    curl = random.uniform(0.0, 2.0 * np.pi, (count, 1)) + 6.0 * share[..., 0]
    wave = 0.006 * share * np.stack((np.cos(curl), np.sin(curl), 0.0 * curl), axis=-1)
    outwards = root[:, None] * (RADIUS + 0.25 * LENGTH * np.sqrt(share))
    return (outwards + 0.8 * LENGTH * share**1.5 * down + wave).astype(np.float32)


def make_scene(count):
    """The scene, with so many strands."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_enable(module="cycles")
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    material, tree, output = add_material("Hair")
    shader = tree.nodes.new("ShaderNodeBsdfDiffuse")
    shader.inputs["Color"].default_value = (0.5, 0.3, 0.2, 1.0)
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    data = bpy.data.hair_curves.new("Hair")
    data.add_curves([KEYS] * count)
    data.attributes["position"].data.foreach_set("vector", strands(count).ravel())
    radius = data.attributes.get("radius") or data.attributes.new("radius", "FLOAT", "POINT")
    radius.data.foreach_set("value", np.full(count * KEYS, THICKNESS, np.float32))
    data.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Hair", data))
    bpy.ops.mesh.primitive_uv_sphere_add(radius=RADIUS, segments=64, ring_count=32)
    bpy.context.object.data.materials.append(material)
    lamp = add_light(scene, "AREA", location=(0.5, -0.5, 0.6), energy=5.0)
    lamp.rotation_euler = (0.7, 0.0, 0.8)
    add_world(scene)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0.0, -0.7, 0.05), (np.pi / 2, 0.0, 0.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = 8
    return scene
