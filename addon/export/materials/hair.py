"""Nodes of hair and points: closures, and what they tell of a strand or point."""

from __future__ import annotations

from typing import Any

import bpy

from .graph import Context, Source
from .translation import TranslateClosure, TranslateValue, Translation

# JSON field, socket name, value where this Blender has no such socket.
PRINCIPLED = (
    ("color", "Color", [0.017513, 0.005763, 0.002059]),
    ("melanin", "Melanin", 0.8),
    ("melanin_redness", "Melanin Redness", 1.0),
    ("tint", "Tint", [1.0, 1.0, 1.0]),
    ("absorption_coefficient", "Absorption Coefficient", [0.245531, 0.52, 1.365]),
    ("aspect_ratio", "Aspect Ratio", 0.85),
    ("roughness", "Roughness", 0.3),
    ("radial_roughness", "Radial Roughness", 0.3),
    ("coat", "Coat", 0.0),
    ("ior", "IOR", 1.55),
    ("offset", "Offset", 0.034907),
    ("random_color", "Random Color", 0.0),
    ("random_roughness", "Random Roughness", 0.0),
    ("random", "Random", None),
    ("reflection", "Reflection", 1.0),
    ("transmission", "Transmission", 1.0),
    ("secondary_reflection", "Secondary Reflection", 1.0),
)
LOBE = (
    ("color", "Color", [0.8, 0.8, 0.8]),
    ("offset", "Offset", 0.0),
    ("roughness_u", "RoughnessU", 0.1),
    ("roughness_v", "RoughnessV", 1.0),
    ("tangent", "Tangent", None),
)
INFO = {
    "Is Strand": "is_strand",
    "Intercept": "intercept",
    "Length": "length",
    "Thickness": "thickness",
    "Tangent Normal": "tangent_normal",
    "Random": "strand_random",
}
POINT_INFO = {"Position": "point_position", "Radius": "point_radius", "Random": "point_random"}


def _values(t: Translation, node: bpy.types.Node, context: Context, fields: Any) -> dict[str, Any]:
    return {field: t.value(node, socket, context, default) for field, socket, default in fields}


def _principled(t: Translation, node: bpy.types.Node, context: Context) -> int:
    settings = {"model": node.model.lower(), "pigment": node.parametrization.lower()}
    return t.emit({"type": "principled_hair", **settings, **_values(t, node, context, PRINCIPLED)})


def _lobe(t: Translation, node: bpy.types.Node, context: Context) -> int:
    return t.emit({"type": "hair_bsdf", "component": node.component.lower(), **_values(t, node, context, LOBE)})


def _info(kind: str, outputs: dict[str, str]) -> TranslateValue:
    """A node without inputs."""

    def translate(t: Translation, source: Source) -> Any:
        return {"node": t.once(source, lambda: {"type": kind}), "output": outputs[source.socket.identifier]}

    return translate


HAIR_CLOSURES: dict[str, TranslateClosure] = {
    "ShaderNodeBsdfHairPrincipled": _principled,
    "ShaderNodeBsdfHair": _lobe,
}

HAIR_VALUES: dict[str, TranslateValue] = {
    "ShaderNodeHairInfo": _info("hair_info", INFO),
    "ShaderNodePointInfo": _info("point_info", POINT_INFO),
}


def asks_for_normals() -> bool:
    """True if a material of the open file may show hair of elliptical cross-section, which lies as its curves' normals
    say."""
    trees = [block.node_tree for block in bpy.data.materials if block.node_tree] + list(bpy.data.node_groups)
    nodes = (node for tree in trees for node in tree.nodes if node.bl_idname == "ShaderNodeBsdfHairPrincipled")
    return any(node.model == "HUANG" for node in nodes)
