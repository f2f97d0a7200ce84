"""Objects with volumes."""

import bpy

from helpers import add, add_material


def add_nodes(scene, build):
    """An object whose geometry nodes make what `build` returns the socket of."""
    tree = bpy.data.node_groups.new("Fog", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    output = tree.nodes.new("NodeGroupOutput")
    tree.links.new(build(tree), output.inputs[0])
    obj = add(scene, "Fog", bpy.data.meshes.new("Fog"))
    obj.modifiers.new("Nodes", "NODES").node_group = tree
    return obj


def add_mesh_to_volume(tree, mesh, voxel_size):
    """A node that fills what a socket gives; voxels have a size of their own."""
    volume = tree.nodes.new("GeometryNodeMeshToVolume")
    if hasattr(volume, "resolution_mode"):  # Before Blender 5.0.
        volume.resolution_mode = "VOXEL_SIZE"
    else:
        volume.inputs["Resolution Mode"].default_value = "Size"
    volume.inputs["Voxel Size"].default_value = voxel_size
    tree.links.new(mesh, volume.inputs["Mesh"])
    return volume


def smoke(density=1.0, color=(0.5, 0.5, 0.5), color_attribute=""):
    """A material of a Principled Volume; returns it, its tree and node."""
    material, tree, output = add_material("Smoke")
    shader = tree.nodes.new("ShaderNodeVolumePrincipled")
    shader.inputs["Density"].default_value = density
    shader.inputs["Color"].default_value = (*color, 1.0)
    shader.inputs["Color Attribute"].default_value = color_attribute
    tree.links.new(shader.outputs[0], output.inputs["Volume"])
    return material, tree, shader


def add_file(scene, path, name="Smoke"):
    """A volume object of a file, with a material that asks for its grids."""
    volume = bpy.data.volumes.new(name)
    volume.filepath = str(path)
    volume.materials.append(smoke(color_attribute="color")[0])
    return add(scene, name, volume)
