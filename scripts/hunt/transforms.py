"""Lamps and meshes under any transform: parents that shear, mirrors, instances of collections and of geometry nodes."""

import math

import bpy
import lamps

import stage

prepare = lamps.prepare


def choices(scene, rng, palette):
    """A lamp or a thing, its parents and what shows it elsewhere."""
    is_lamp = rng.random() < 0.7
    obj = lamps.new_lamp(scene, rng, "Lamp") if is_lamp else thing(scene, rng)
    if is_lamp:
        yield from lamps.settings_of(rng, obj)
    for name, value in (("scale", lengths(rng)), ("delta_scale", lengths(rng))):
        if rng.random() < 0.5:
            yield f"{name} = {value!r}", lambda name=name, value=value: setattr(obj, name, value)
    child = obj
    for number in range(rng.choice([0, 1, 1, 2])):
        parent = stage.add(scene, f"Parent {number}", None)
        turned, scaled = [rng.uniform(-1, 1) for _ in range(3)], lengths(rng)
        yield f"parent {number}: {turned}, {scaled}", lambda c=child, p=parent, t=turned, s=scaled: under(c, p, t, s)
        child = parent
    shown = rng.choice(["", "", "collection", "nodes"])
    if shown:
        seed = rng.random()
        yield f"instanced by {shown}", lambda: instance(scene, obj, shown, seed)


def lengths(rng):
    """A scale of three axes: even, stretched, mirrored or flat."""
    even = rng.uniform(0.4, 2.0)
    stretched = [rng.uniform(0.3, 2.0) for _ in range(3)]
    kinds = [[even] * 3, stretched, stretched, [-v for v in stretched], [-even, even, even], [even, even, -even]]
    return [round(v, 3) for v in rng.choice(kinds)]


def thing(scene, rng):
    """A mesh whose material sees its space, with a lamp over it."""
    lamps.new_lamp(scene, rng, "Key")
    material, tree, output = stage.new_material("Thing")
    coordinates, noise, shader = (
        tree.nodes.new(f"ShaderNode{kind}") for kind in ("TexCoord", "TexChecker", "BsdfDiffuse")
    )
    noise.inputs["Scale"].default_value = 3.0
    tree.links.new(coordinates.outputs[rng.choice(["Generated", "Normal", "UV", "Object"])], noise.inputs["Vector"])
    tree.links.new(noise.outputs[0], shader.inputs["Color"])
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    obj = stage.add(scene, "Thing", stage.ball("Thing", 0.7, material, smooth=rng.random() < 0.7))
    obj.location = (-0.9, rng.uniform(-1, 0.5), rng.uniform(0.7, 1.2))
    return obj


def under(child, parent, turned, scaled):
    """Puts an object under a parent, where it stays about where it was."""
    parent.rotation_euler, parent.scale = turned, scaled
    parent.location, child.location = child.location.copy(), (0.1, 0.05, -0.1)
    child.parent = parent


def instance(scene, obj, shown, seed):
    """Shows what is in the scene by an instance instead."""
    chain = [obj]
    while chain[-1].parent:
        chain.append(chain[-1].parent)
    collection = bpy.data.collections.new("Shown")
    for member in chain:
        collection.objects.link(member)
        scene.collection.objects.unlink(member)
    turn, scale = 2 * math.pi * seed, [1.0, 0.5 + seed, -1.0 if seed > 0.5 else 1.0]
    if shown == "collection":
        empty = stage.add(scene, "Instance", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", collection
        empty.rotation_euler, empty.scale, empty.location.z = (0, 0, turn), scale, 1.0 if scale[2] > 0 else 3.0
        return
    carrier = stage.add(scene, "Instances", bpy.data.meshes.new("Instances"))
    carrier.modifiers.new("Nodes", "NODES").node_group = instancing_nodes(collection, turn, scale)


def instancing_nodes(collection, turn, scale):
    """Geometry nodes that show a collection on two points."""
    tree = bpy.data.node_groups.new("Instances", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kinds = ("GeometryNodeMeshLine", "GeometryNodeInstanceOnPoints", "NodeGroupOutput", "GeometryNodeCollectionInfo")
    points, instances, output, info = (tree.nodes.new(kind) for kind in kinds)
    points.inputs["Count"].default_value = 2
    points.inputs["Offset"].default_value = (0.6, 0.3, 0)
    points.inputs["Start Location"].default_value = (0, 0, 0.5 if scale[2] > 0 else 3.0)
    info.inputs["Collection"].default_value = collection
    instances.inputs["Rotation"].default_value = (0.1, 0, turn)
    instances.inputs["Scale"].default_value = scale
    tree.links.new(points.outputs[0], instances.inputs["Points"])
    tree.links.new(info.outputs[0], instances.inputs["Instance"])
    tree.links.new(instances.outputs[0], output.inputs[0])
    return tree
