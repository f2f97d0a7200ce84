"""No input of a closure is left unread in silence: what is linked to it changes the material, or is named."""

import bpy
import pytest

from addon.export.materials.closures import CLOSURES
from helpers import add_material, add_quad, exported

pytestmark = pytest.mark.every_version

NOT_OF_CYCLES = {"Weight"}
"""Inputs that Blender keeps for itself."""

WITHOUT_EFFECT = {
    "ShaderNodeBsdfPrincipled": {
        *("Subsurface Radius", "Subsurface Scale", "Subsurface IOR", "Subsurface Anisotropy", "Thin Film IOR"),
        *("Transmission Dispersion Scale", "Transmission Dispersion Abbe Number", "Thin Wall"),
    },
    "ShaderNodeBsdfGlass": {"Rotation", "Tangent", "Thin Film IOR"},
    "ShaderNodeBsdfMetallic": {"IOR", "Extinction", "Thin Film IOR"},
    "ShaderNodeVolumeScatter": {"IOR", "Backscatter", "Alpha", "Diameter"},
    "ShaderNodeVolumeCoefficients": {"IOR", "Backscatter", "Alpha", "Diameter"},
}
"""Inputs that do nothing as long as another, which is named, is 0, or of models that are not the default."""


def closure(name, kind, linked=None):
    """A material of one closure, with a number linked to one of its inputs."""
    material, tree, output = add_material(name)
    node = tree.nodes.new(kind)
    tree.links.new(node.outputs[0], output.inputs["Volume" if "Volume" in kind else "Surface"])
    if linked is not None:
        number = tree.nodes.new("ShaderNodeValue")
        number.outputs[0].default_value = 0.37
        tree.links.new(number.outputs[0], node.inputs[linked])
    return material


def inputs(kind):
    """Numbers of the inputs of a node that a value can be linked to, with their names."""
    node = closure("Any", kind).node_tree.nodes[kind_name(kind)]
    return [
        (number, socket.name)
        for number, socket in enumerate(node.inputs)
        if socket.type in {"VALUE", "RGBA", "VECTOR", "INT", "BOOLEAN"}
        and socket.name not in NOT_OF_CYCLES | WITHOUT_EFFECT.get(kind, set())
    ]


def kind_name(kind):
    """Name that Blender gives a new node of a type."""
    tree = bpy.data.node_groups.new("names", "ShaderNodeTree")
    return tree.nodes.new(kind).name


def test_every_input_of_every_closure_is_read_or_named(scene):
    wanted = {}
    for kind in (kind for kind in CLOSURES if hasattr(bpy.types, kind)):
        wanted[kind] = closure(kind, kind)
        for number, name in inputs(kind):
            wanted[f"{kind} {name}"] = closure(f"{kind} {name}", kind, linked=number)
    quads = [add_quad(scene, name, material=material) for name, material in wanted.items()]
    summary = exported(scene)
    assert len(summary["materials"]) == len(quads)
    parts = ("nodes", "surface", "volume")
    found = {material["name"]: [material.get(part) for part in parts] for material in summary["materials"]}
    said = " ".join(summary["warnings"])
    unread = [
        name
        for name, description in found.items()
        if " " in name and description == found[name.split(" ")[0]] and f"material '{name}'" not in said
    ]
    assert unread == []
