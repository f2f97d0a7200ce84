"""Feature scenes of fog, liquids and clouds. Needs `bpy`."""

from pathlib import Path

import bpy
import numpy as np

from blend_tests.vdb_file import write_vdb

from . import hair, stage


def fog_box(scene):
    """A cube of grey fog that scatters several times."""
    stage.add_box(scene, "Fog", 2.2, stage.volume("Fog", Color=(0.9, 0.9, 0.9, 1.0), Density=0.8)[0])
    _scatter_often(scene)


def fog_forward(scene):
    """A ball of fog that scatters forward."""
    fog = stage.volume("Fog", Color=(0.8, 0.8, 0.8, 1.0), Density=1.5, Anisotropy=0.6)[0]
    stage.add_ball(scene, "Fog", 0.9, fog)
    _scatter_often(scene)


def fog_varying(scene):
    """A cube of fog whose density follows a wave."""
    material, tree, node = stage.volume("Fog", Color=(0.85, 0.85, 0.85, 1.0))
    wave, scale = tree.nodes.new("ShaderNodeTexWave"), tree.nodes.new("ShaderNodeMath")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    scale.operation = "MULTIPLY"
    scale.inputs[1].default_value = 2.0
    tree.links.new(coordinates.outputs["Object"], wave.inputs["Vector"])
    tree.links.new(wave.outputs[1], scale.inputs[0])
    tree.links.new(scale.outputs[0], node.inputs["Density"])
    stage.add_box(scene, "Fog", 1.9, material)
    _scatter_often(scene)
    stage.step_finely(scene)


def world_fog(scene):
    """Thin fog everywhere."""
    _fill_world(scene, Color=(0.9, 0.9, 0.9, 1.0), Density=0.08)


def world_fog_and_box(scene):
    """Thin fog everywhere and a denser cube in it."""
    _fill_world(scene, Color=(0.8, 0.85, 0.9, 1.0), Density=0.05)
    stage.add_box(scene, "Fog", 1.6, stage.volume("Fog", Color=(0.9, 0.9, 0.9, 1.0), Density=0.7)[0])
    _scatter_often(scene)


def world_fog_with_glass(scene):
    """Fog everywhere, seen past and through a glass ball."""
    _fill_world(scene, Color=(0.9, 0.9, 0.9, 1.0), Density=0.06, Anisotropy=0.3)
    glass = stage.hunt.plain_material("Glass", "ShaderNodeBsdfGlass", Roughness=0.2)
    stage.add_ball(scene, "Ball", 0.6, glass)


def hair_in_fog(scene):
    """A tuft of hair in fog."""
    _fill_world(scene, Color=(0.9, 0.9, 0.9, 1.0), Density=0.08)
    hair.tuft_chiang(scene)


def absorbing_liquid(scene):
    """A ball of glass filled with a coloured absorber."""
    material, tree, output = stage.hunt.new_material("Liquid")
    glass, absorption = tree.nodes.new("ShaderNodeBsdfGlass"), tree.nodes.new("ShaderNodeVolumeAbsorption")
    glass.inputs["Roughness"].default_value = 0.15
    glass.inputs["IOR"].default_value = 1.33
    absorption.inputs["Color"].default_value = (0.9, 0.5, 0.1, 1.0)
    absorption.inputs["Density"].default_value = 1.5
    tree.links.new(glass.outputs[0], output.inputs["Surface"])
    tree.links.new(absorption.outputs[0], output.inputs["Volume"])
    stage.add_ball(scene, "Liquid", 0.8, material)


def tinted_fog(scene):
    """A cube of fog whose extinction differs by colour."""
    stage.add_box(scene, "Fog", 1.9, stage.volume("Fog", Color=(0.9, 0.4, 0.6, 1.0), Density=1.0, Anisotropy=0.4)[0])
    _scatter_often(scene)


def milky_liquid(scene):
    """A cube that scatters and absorbs in different colours, of varying density."""
    material, tree, output = stage.hunt.new_material("Milk")
    both = tree.nodes.new("ShaderNodeAddShader")
    scatter, absorb = tree.nodes.new("ShaderNodeVolumeScatter"), tree.nodes.new("ShaderNodeVolumeAbsorption")
    scatter.inputs["Color"].default_value = (0.9, 0.8, 0.7, 1.0)
    scatter.inputs["Density"].default_value = 1.2
    absorb.inputs["Color"].default_value = (0.3, 0.6, 0.9, 1.0)
    ramp, coordinates = tree.nodes.new("ShaderNodeSeparateXYZ"), tree.nodes.new("ShaderNodeTexCoord")
    tree.links.new(coordinates.outputs["Generated"], ramp.inputs[0])
    tree.links.new(ramp.outputs[2], absorb.inputs["Density"])
    for slot, node in enumerate((scatter, absorb)):
        tree.links.new(node.outputs[0], both.inputs[slot])
    tree.links.new(both.outputs[0], output.inputs["Volume"])
    stage.add_box(scene, "Milk", 1.8, material)
    _scatter_often(scene)
    stage.step_finely(scene)


def overlapping(scene):
    """Two cubes of fog that overlap, one of them tinted by what it absorbs."""
    fog = stage.volume("Left", Color=(0.9, 0.9, 0.9, 1.0), Density=0.8)[0]
    stage.add_box(scene, "Left", 1.6, fog, (-0.5, 0.0, 0.0))
    absorber = stage.volume("Right", "ShaderNodeVolumeAbsorption", Color=(0.3, 0.3, 0.3, 1.0), Density=0.7)[0]
    stage.add_box(scene, "Right", 1.6, absorber, (0.5, 0.3, 0.1))
    _scatter_often(scene)


def camera_inside(scene):
    """Fog in a box that holds the camera too."""
    stage.add_box(scene, "Fog", 14.0, stage.volume("Fog", Color=(0.9, 0.9, 0.9, 1.0), Density=0.07)[0])
    _scatter_often(scene)


def nested(scene):
    """A dense ball within a thin one within a thin cube."""
    for size, density in ((1.0, 0.4), (0.5, 1.5)):
        fog = stage.volume(f"Ball {size}", Color=(0.9, 0.9, 0.9, 1.0), Density=density)[0]
        stage.add_ball(scene, f"Ball {size}", size, fog)
    stage.add_box(scene, "Cube", 2.4, stage.volume("Cube", Color=(0.9, 0.9, 0.9, 1.0), Density=0.15)[0])
    _scatter_often(scene)


def cloud(scene):
    """A ball of voxels made by geometry nodes, in a principled volume."""
    _add_voxels(scene, "MeshToVolume")


def voxel_cube(scene):
    """A cube of voxels whose density is a function of place."""
    _add_voxels(scene, "VolumeCube")


def glowing_cloud(scene):
    """Voxels that emit as well."""
    node = _add_voxels(scene, "VolumeCube")
    node.inputs["Emission Strength"].default_value = 0.1
    node.inputs["Emission Color"].default_value = (1.0, 0.5, 0.2, 1.0)


def smoke_file(scene):
    """A plume read from an OpenVDB file, with a colour grid."""
    x, y, z = np.meshgrid(*[np.linspace(-1, 1, 32)] * 3, indexing="ij")
    radius = np.hypot(x + 0.25 * np.sin(4 * z), y + 0.25 * np.cos(5 * z)) / (0.35 + 0.2 * z)
    density = np.maximum(1 - radius, 0) * (1.2 + np.sin(9 * x) * np.sin(8 * y + 3 * z))
    color = np.stack([0.8 + 0.15 * z, 0.75 + 0 * z, 0.8 - 0.15 * z], axis=-1)
    path = Path(bpy.app.tempdir) / "plume.vdb"
    write_vdb(path, {"density": density, "color": color}, 2 / 31, (-1.0, -1.0, -1.0))
    material, _, node = stage.volume("Smoke", "ShaderNodeVolumePrincipled", Density=6.0)
    node.inputs["Density Attribute"].default_value = "density"
    node.inputs["Color Attribute"].default_value = "color"
    volume = bpy.data.volumes.new("Smoke")
    volume.filepath = str(path)
    volume.materials.append(material)
    stage.hunt.add(scene, "Smoke", volume)
    _scatter_often(scene)
    stage.step_finely(scene)


def phase_functions(scene):
    """A ball of each phase function; that of Henyey and Greenstein alone before Blender 4.3."""
    kinds = ["HENYEY_GREENSTEIN"]
    if bpy.app.version >= (4, 3, 0):
        kinds += ["FOURNIER_FORAND", "DRAINE", "RAYLEIGH", "MIE"]
    for number, kind in enumerate(kinds):
        material, _, node = stage.volume(kind, Color=(0.9, 0.9, 0.9, 1.0), Density=3.0)
        if hasattr(node, "phase"):
            node.phase = kind
        x = (number - (len(kinds) - 1) / 2) * 0.8
        stage.add_ball(scene, kind.title(), 0.38, material, (x, 0.0, 0.0))
    _scatter_often(scene)


def _scatter_often(scene):
    scene.cycles.volume_bounces = 4
    stage.keep_lamps_out_of_forward_hits(scene)


def _fill_world(scene, **inputs):
    tree = scene.world.node_tree
    node = tree.nodes.new("ShaderNodeVolumeScatter")
    for key, value in inputs.items():
        node.inputs[key].default_value = value
    output = next(found for found in tree.nodes if found.bl_idname == "ShaderNodeOutputWorld")
    tree.links.new(node.outputs[0], output.inputs["Volume"])
    _scatter_often(scene)


def _add_voxels(scene, kind):
    """A volume that geometry nodes make, with a principled volume of its density; returns the shader."""
    material, _, node = stage.volume("Cloud", "ShaderNodeVolumePrincipled", Color=(0.9, 0.9, 0.9, 1.0), Density=1.5)
    tree = bpy.data.node_groups.new("Voxels", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    output = tree.nodes.new("NodeGroupOutput")
    if kind == "VolumeCube":
        voxels = tree.nodes.new("GeometryNodeVolumeCube")
        position = tree.nodes.new("GeometryNodeInputPosition")
        length = tree.nodes.new("ShaderNodeVectorMath")
        length.operation = "LENGTH"
        fall = tree.nodes.new("ShaderNodeMapRange")
        for name, value in (("From Min", 0.4), ("From Max", 0.9), ("To Min", 2.0), ("To Max", 0.0)):
            fall.inputs[name].default_value = value
        tree.links.new(position.outputs[0], length.inputs[0])
        tree.links.new(length.outputs["Value"], fall.inputs["Value"])
        tree.links.new(fall.outputs[0], voxels.inputs["Density"])
        for name in ("Resolution X", "Resolution Y", "Resolution Z"):
            voxels.inputs[name].default_value = 24
    else:
        ball = tree.nodes.new("GeometryNodeMeshIcoSphere")
        ball.inputs["Radius"].default_value = 0.8
        ball.inputs["Subdivisions"].default_value = 4
        voxels = tree.nodes.new("GeometryNodeMeshToVolume")
        voxels.inputs["Voxel Amount"].default_value = 24
        tree.links.new(ball.outputs[0], voxels.inputs[0])
    paint = tree.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = material
    tree.links.new(voxels.outputs[0], paint.inputs["Geometry"])
    tree.links.new(paint.outputs[0], output.inputs[0])
    holder = stage.hunt.add(scene, "Cloud", bpy.data.meshes.new("Cloud"))
    holder.data.materials.append(material)
    holder.modifiers.new("Voxels", "NODES").node_group = tree
    _scatter_often(scene)
    stage.step_finely(scene)
    return node


SCENES = {
    build.__name__: build
    for build in (
        fog_box,
        fog_forward,
        fog_varying,
        world_fog,
        world_fog_and_box,
        world_fog_with_glass,
        hair_in_fog,
        absorbing_liquid,
        tinted_fog,
        milky_liquid,
        overlapping,
        nested,
        camera_inside,
        cloud,
        voxel_cube,
        glowing_cloud,
        smoke_file,
        phase_functions,
    )
}
