"""Hair and points, and how they look in Relume and in Cycles."""

import bpy
import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add, add_light, add_material, add_quad, add_world, render_cycles


def diffuse(name="Hair", color=(0.8, 0.5, 0.3)):
    material, tree, output = add_material(name)
    node = tree.nodes.new("ShaderNodeBsdfDiffuse")
    node.inputs["Color"].default_value = (*color, 1.0)
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def add_strands(scene, keys, radius=None, material=None):
    """Hair curves with keys [curves, keys, 3]."""
    data = bpy.data.hair_curves.new("Fur")
    data.add_curves([keys.shape[1]] * len(keys))
    data.attributes["position"].data.foreach_set("vector", keys.astype(np.float32).ravel())
    if radius is not None:
        attribute = data.attributes.get("radius") or data.attributes.new("radius", "FLOAT", "POINT")
        attribute.data.foreach_set("value", np.broadcast_to(radius, keys.shape[:2]).astype(np.float32).ravel())
    if material:
        data.materials.append(material)
    return add(scene, "Fur", data)


def bent_strands(count=40, keys=5, seed=1):
    """Strands that stand about the origin and bend."""
    random = np.random.default_rng(seed)
    roots = np.column_stack((random.uniform(-1, 1, (count, 2)), np.zeros(count)))
    steps = np.linspace(0.0, 1.0, keys)[None, :, None]
    lean, bend = random.normal(0, 0.5, (2, count, 1, 3))
    return roots[:, None] + steps * (lean + [0.0, 0.0, 0.4]) + steps**2 * bend


def look(scene, size=24):
    """A sun, a weak sky, and a camera that sees all of it from above."""
    sun = add_light(scene, "SUN", energy=3.0, angle=0.3)
    sun.rotation_euler = (0.6, 0.3, 0.0)
    add_world(scene, (0.3, 0.4, 0.6), 0.5)
    scene.camera.data.type, scene.camera.data.ortho_scale = "ORTHO", 3.0
    scene.render.resolution_x = scene.render.resolution_y = size
    cycles = scene.cycles
    cycles.max_bounces = cycles.diffuse_bounces = 2
    cycles.pixel_filter_type = "BOX"


def assert_like_cycles(scene, tmp_path, samples=256):
    """The mean and blocks of four by four pixels agree, within the noise of both."""
    folder = tmp_path / "bake"
    settings = trace_settings(scene, lambda _: None) | {"samples": 4 * samples}
    loaded = load_scene(scene)
    relume.bake(loaded, folder, settings).wait()
    ours = relume.Relighter(folder).relight(loaded.lights(), denoise=False)["combined"][::-1]
    cycles = render_cycles(scene, samples=samples)
    assert cycles.mean() > 0.05
    assert ours.mean() == pytest.approx(cycles.mean(), rel=0.01)
    blocks = [image.reshape(6, 4, 6, 4, 3).mean(axis=(1, 3, 4)) for image in (ours, cycles)]
    difference = np.abs(blocks[0] - blocks[1])
    assert difference.max() < 0.06 * cycles.mean() + 0.04 * blocks[1].max(), difference.round(3)


def straighten(fur):
    """Nodes that make poly curves of hair."""
    tree = bpy.data.node_groups.new("Straight", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeCurveSplineType", "NodeGroupOutput")
    source, kind, output = (tree.nodes.new(name) for name in kinds)
    kind.spline_type = "POLY"
    tree.links.new(source.outputs[0], kind.inputs["Curve"])
    tree.links.new(kind.outputs[0], output.inputs[0])
    fur.modifiers.new("Straight", "NODES").node_group = tree


def meadow(scene, **settings):
    """Hair of a particle system on a square."""
    ground = add_quad(scene, "Meadow", material=diffuse("Ground", (0.2, 0.3, 0.1)))
    ground.data.materials.append(diffuse("Grass"))
    system = ground.modifiers.new("Grass", "PARTICLE_SYSTEM").particle_system
    defaults = {"type": "HAIR", "count": 60, "hair_length": 0.5, "material": 2, "root_radius": 4.0, "tip_radius": 1.0}
    for name, value in (defaults | settings).items():
        setattr(system.settings, name, value)
    return ground


def add_cloud(scene, positions, radii, material):
    """A point cloud, which nodes make of a mesh's vertices: it can be made in no other way in all versions."""
    mesh = bpy.data.meshes.new("Dust")
    mesh.from_pydata(positions.tolist(), [], [])
    mesh.attributes.new("thickness", "FLOAT", "POINT").data.foreach_set("value", radii.astype(np.float32))
    mesh.materials.append(material)
    obj = add(scene, "Dust", mesh)
    tree = bpy.data.node_groups.new("Dust", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    kinds = ("NodeGroupInput", "GeometryNodeMeshToPoints", "GeometryNodeInputNamedAttribute", "NodeGroupOutput")
    source, points, named, output = (tree.nodes.new(kind) for kind in kinds)
    material_node = tree.nodes.new("GeometryNodeSetMaterial")
    material_node.inputs["Material"].default_value = material
    named.inputs["Name"].default_value = "thickness"
    tree.links.new(source.outputs[0], points.inputs["Mesh"])
    tree.links.new(named.outputs["Attribute"], points.inputs["Radius"])
    tree.links.new(points.outputs[0], material_node.inputs["Geometry"])
    tree.links.new(material_node.outputs[0], output.inputs[0])
    obj.modifiers.new("Dust", "NODES").node_group = tree
    return obj
