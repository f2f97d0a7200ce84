"""Writes volume_VERSION.vdb, for tests of the reader: a cube of 12 x 12 x 12 voxels with the density 7 + x + 2 y + 3 z
of its own places from -1 to 1, turned and moved. To be run by the Python of Blender 4.2 and 5.3."""

from pathlib import Path

import bpy

bpy.ops.wm.read_factory_settings(use_empty=True)
tree = bpy.data.node_groups.new("Cube", "GeometryNodeTree")
tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
kinds = ("GeometryNodeVolumeCube", "GeometryNodeInputPosition", "ShaderNodeVectorMath", "ShaderNodeMath")
cube, position, dot, plus = map(tree.nodes.new, kinds)
dot.operation, dot.inputs[1].default_value = "DOT_PRODUCT", (1.0, 2.0, 3.0)
plus.operation, plus.inputs[1].default_value = "ADD", 7.0
for axis in "XYZ":
    cube.inputs[f"Resolution {axis}"].default_value = 12
transform = tree.nodes.new("GeometryNodeTransform")
transform.inputs["Rotation"].default_value = (0.0, 0.0, 0.5)
transform.inputs["Translation"].default_value = (1.0, 2.0, 3.0)
tree.links.new(position.outputs[0], dot.inputs[0])
tree.links.new(dot.outputs["Value"], plus.inputs[0])
tree.links.new(plus.outputs[0], cube.inputs["Density"])
tree.links.new(cube.outputs[0], transform.inputs["Geometry"])
tree.links.new(transform.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
obj = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
obj.modifiers.new("Nodes", "NODES").node_group = tree
bpy.context.scene.collection.objects.link(obj)
instances = bpy.context.evaluated_depsgraph_get().object_instances
volume = next(instance.object.data for instance in instances if instance.object.type == "VOLUME")
volume.grids.load()
version = "_".join(map(str, bpy.app.version[:2]))
volume.grids.save(str(Path(__file__).with_name(f"volume_{version}.vdb")))
