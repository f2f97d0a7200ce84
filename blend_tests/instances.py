"""Lights that are instanced, for tests."""

import bpy

from helpers import add, add_quad


def bulb(*collections):
    """A light in some collections, or in none."""
    light = bpy.data.lights.new("Bulb", "POINT")
    light.energy, light.shadow_soft_size = 100.0, 0.3
    obj = bpy.data.objects.new("Bulb", light)
    for collection in collections:
        collection.objects.link(obj)
    return obj


def unlinked(name, *objects):
    """A collection that is not in the scene."""
    made = bpy.data.collections.new(name)
    for obj in objects:
        made.objects.link(obj)
    return made


def scatter(collection, source):
    """An object whose nodes show an object or a collection twice, 2 m above the ground."""
    obj = bpy.data.objects.new("Scatter", bpy.data.meshes.new("Scatter"))
    collection.objects.link(obj)
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    kind = "Object" if isinstance(source, bpy.types.Object) else "Collection"
    kinds = ("GeometryNodeMeshLine", "GeometryNodeInstanceOnPoints", "NodeGroupOutput", f"GeometryNode{kind}Info")
    line, points, output, info = (tree.nodes.new(name) for name in kinds)
    line.inputs["Count"].default_value = 2
    line.inputs["Start Location"].default_value, line.inputs["Offset"].default_value = (-0.5, 0, 2), (1, 0, 0)
    info.inputs[kind].default_value = source
    if kind == "Object":
        info.inputs["As Instance"].default_value = True
    tree.links.new(line.outputs[0], points.inputs["Points"])
    tree.links.new(info.outputs["Geometry" if kind == "Object" else 0], points.inputs["Instance"])
    tree.links.new(points.outputs[0], output.inputs[0])
    obj.modifiers.new("Scatter", "NODES").node_group = tree
    return obj


def instancing(scene, collection):
    """An empty in the scene that instances a collection."""
    empty = add(scene, "Instance", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", collection
    return empty


def particles(scene, **shown):
    """Two hairs that show something."""
    obj = add_quad(scene, "Meadow", size=1.0)
    obj.location.z = 2.0
    obj.modifiers.new("Meadow", "PARTICLE_SYSTEM")
    settings = obj.particle_systems[0].settings
    settings.type, settings.count = "HAIR", 2
    settings.render_type = "OBJECT" if "instance_object" in shown else "COLLECTION"
    for name, value in shown.items():
        setattr(settings, name, value)


def newest(live):
    """The lights of the newest request by name, those that are off left out."""
    request = live.requests[-1]
    return {light["name"]: light for light in request["lights"] if any(request["gains"][light["name"]])}
