"""Decisions on each shader node of Blender: equal to Cycles, approximated (how), not there (why), or none of Cycles.
Nodes of the exporter's tables are equal but for the exceptions here. A test asks for a decision on each node of the
running Blender; `scripts/coverage.py` writes them all down."""

from addon.export.materials.exporter import TABLES
from addon.export.materials.graph import LEFT_OUT

EQUAL, APPROXIMATED, NOT, NONE = "equal", "approximated", "not", "none"

STRUCTURE = "no shader: it only arranges or connects others"
OUTPUTS = "an output: what feeds it is exported, other outputs make no picture"
OTHER_ENGINE = "of EEVEE or Freestyle; Cycles does not know it"
RAYCAST = "Position", "Direction", "Length", "Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal"
"""Sockets of the node Raycast but those of attributes."""
MET = "attributes of what is met are named, and 0"
SHEEN = "up to 4 % off, 12 % seen from the side: a fit to Cycles' table"
PURE_COLORS = "colours beyond the working space are taken from the nearest wavelengths"

ELSEWHERE = {
    "ShaderNodeRGB",
    "ShaderNodeValue",
    "FunctionNodeInputBool",
    "FunctionNodeInputInt",
    "FunctionNodeInputVector",
    *("FunctionNodeInputMenu", "FunctionNodeInputSpecialCharacters", "FunctionNodeInputString"),
    *(
        "FunctionNodeFormatString",
        "FunctionNodeReplaceString",
        "FunctionNodeReverseString",
        "FunctionNodeSetStringCase",
    ),
    *("FunctionNodeSliceString", "FunctionNodeTrimString", "FunctionNodeValueToString"),
    *("GeometryNodeInputSceneTime", "GeometryNodeRepeatInput", "GeometryNodeRepeatOutput", "GeometryNodeWarning"),
    *("NodeClosureInput", "NodeClosureOutput", "NodeEvaluateClosure", "NodeImplicitConversion"),
    *("NodeCombineBundle", "NodeJoinBundle", "NodeSeparateBundle"),
}
"""Constants, texts, and nodes that hand on their inputs: the graph itself follows them."""

NODES: dict[str, tuple[str, str]] = {
    **dict.fromkeys(LEFT_OUT, (NONE, OTHER_ENGINE)),
    **dict.fromkeys(
        ("NodeFrame", "NodeReroute", "NodeGroupInput", "NodeGroupOutput", "ShaderNodeGroup", "NodeComment"),
        (NONE, STRUCTURE),
    ),
    **dict.fromkeys(
        ("ShaderNodeOutputMaterial", "ShaderNodeOutputWorld", "ShaderNodeOutputLight", "ShaderNodeOutputAOV"),
        (NONE, OUTPUTS),
    ),
    "ShaderNodeOutputLineStyle": (NONE, OTHER_ENGINE),
    "ShaderNodeLightIterInternalInput": (NONE, OTHER_ENGINE),
    "ShaderNodeLightIterInternalOutput": (NONE, OTHER_ENGINE),
    "ShaderNodeLightFalloff": (APPROXIMATED, "in lights where it is a factor on all of the light; else named"),
    "ShaderNodeScript": (NOT, "named: scripts in Open Shading Language run in Cycles alone"),
    "GeometryNodeMenuSwitch": (EQUAL, ""),
    "ShaderNodeRaycast": (APPROXIMATED, MET),
}


OPTIONS: dict[tuple[str, str, str], tuple[str, str]] = {
    ("ShaderNodeBsdfHairPrincipled", "model", "HUANG"): (
        APPROXIMATED,
        "that of Blender 4.5 on, where Blender is older",
    ),
    ("ShaderNodeAttribute", "attribute_type", "INSTANCER"): (
        APPROXIMATED,
        "without what geometry nodes give, before Blender 4.5",
    ),
}
"""Items of properties that differ from their node."""

SOCKETS: dict[tuple[str, str], tuple[str, str]] = {
    ("ShaderNodeBsdfTranslucent", "Normal"): (
        APPROXIMATED,
        "turned away from the camera, worlds and large lamps light it more",
    ),
    **{("ShaderNodeRaycast", socket): (EQUAL, "") for socket in RAYCAST},
    ("ShaderNodeBsdfPrincipled", "Transmission Dispersion Scale"): (APPROXIMATED, PURE_COLORS),
    ("ShaderNodeBsdfPrincipled", "Transmission Dispersion Abbe Number"): (APPROXIMATED, PURE_COLORS),
    ("ShaderNodeBsdfPrincipled", "Sheen Weight"): (APPROXIMATED, SHEEN),
    ("ShaderNodeBsdfSheen", "Roughness"): (APPROXIMATED, SHEEN),
}
"""Inputs and outputs, by their identifiers, that differ from their node."""


def decision(node: str) -> tuple[str, str] | None:
    """Status of a node by its `bl_idname`, with words where it is not equal; None if nobody has decided."""
    if node in NODES:
        return NODES[node]
    if node in ELSEWHERE or any(node in table for table in (TABLES.closures, TABLES.values, TABLES.volumes)):
        return EQUAL, ""
    return None
