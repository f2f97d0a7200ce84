"""Decisions on each shader node of Blender: equal to Cycles, approximated (how), not there (why), or none of Cycles.
Nodes of the exporter's tables are equal but for the exceptions here. A test asks for a decision on each node of the
running Blender; `scripts/coverage.py` writes them all down."""

from addon.export.materials.exporter import TABLES
from addon.export.materials.graph import LEFT_OUT

EQUAL, APPROXIMATED, NOT, NONE = "equal", "approximated", "not", "none"

STRUCTURE = "no shader: it only arranges or connects others"
OUTPUTS = "an output: what feeds it is exported, other outputs make no picture"
OTHER_ENGINE = "of EEVEE or Freestyle; Cycles does not know it"
COMPUTED = "only where Blender itself computes it from constants; named, and taken as a constant"
NO_INPUT = "named, and taken as a constant"

ELSEWHERE = {
    "ShaderNodeRGB",
    "ShaderNodeValue",
    "FunctionNodeInputBool",
    "FunctionNodeInputInt",
    "FunctionNodeInputVector",
}
"""Constants, which the graph itself follows."""

NODES: dict[str, tuple[str, str]] = {
    **dict.fromkeys(LEFT_OUT, (NONE, OTHER_ENGINE)),
    **dict.fromkeys(TABLES.fallback_closures, (NOT, "named, and black")),
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
    "ShaderNodeAmbientOcclusion": (NOT, "named, and its colour"),
    "ShaderNodeBevel": (NOT, "named, and the normal as it is"),
    "ShaderNodeTexSky": (APPROXIMATED, "in worlds as Cycles renders it; in materials named, and a constant"),
    "ShaderNodeLightFalloff": (APPROXIMATED, "in lights where it is a factor on all of the light; else named"),
    "ShaderNodeTexIES": (APPROXIMATED, "in lights; in materials named, and a constant"),
    "ShaderNodeScript": (NOT, "named: scripts in Open Shading Language run in Cycles alone"),
    "GeometryNodeMenuSwitch": (EQUAL, ""),
    **dict.fromkeys(
        (
            *("ShaderNodeParticleInfo", "ShaderNodeTangent", "ShaderNodeWavelength"),
            *("ShaderNodeWireframe", "ShaderNodeTexPointDensity", "ShaderNodeRadialTiling", "ShaderNodeRaycast"),
            "ShaderNodeTexGabor",
        ),
        (NOT, NO_INPUT),
    ),
}

COMPUTED_BY_BLENDER = (
    *("FunctionNode", "GeometryNodeIndexSwitch", "GeometryNodeSwitch", "GeometryNodeRepeat", "GeometryNodeWarning"),
    *("GeometryNodeInputSceneTime", "NodeClosure", "NodeCombineBundle", "NodeEnableOutput", "NodeEvaluateClosure"),
    *("NodeImplicitConversion", "NodeJoinBundle", "NodeSeparateBundle"),
)
"""How the names of nodes begin that shaders share with other trees."""

OPTIONS: dict[tuple[str, str, str], tuple[str, str]] = {
    ("ShaderNodeBsdfHairPrincipled", "model", "HUANG"): (
        APPROXIMATED,
        "that of Blender 4.5 on, where Blender is older",
    ),
    ("ShaderNodeNormalMap", "space", "BLENDER_OBJECT"): (APPROXIMATED, "Cycles is brighter where normals turn away"),
    ("ShaderNodeNormalMap", "space", "BLENDER_WORLD"): (APPROXIMATED, "Cycles is brighter where normals turn away"),
    ("ShaderNodeAttribute", "attribute_type", "INSTANCER"): (APPROXIMATED, "not what geometry nodes give instances"),
    ("ShaderNodeVectorMath", "operation", "WRAP"): (NOT, "named, and its first input"),
    ("ShaderNodeVectorMath", "operation", "FACEFORWARD"): (NOT, "named, and its first input"),
    ("ShaderNodeVectorMath", "operation", "REFRACT"): (NOT, "named, and its first input"),
    ("ShaderNodeVectorMath", "operation", "SIGN"): (NOT, "named, and its first input"),
    ("ShaderNodeVectorMath", "operation", "POWER"): (NOT, "named, and its first input"),
    ("ShaderNodeVectorMath", "operation", "ROUND"): (NOT, "named, and its first input"),
    ("ShaderNodeMix", "data_type", "ROTATION"): (NOT, "named, and black"),
}
"""Items of properties that differ from their node."""

SOCKETS: dict[tuple[str, str], tuple[str, str]] = {
    ("ShaderNodeBsdfPrincipled", "Thin Film Thickness"): (NOT, "named, and none"),
    ("ShaderNodeBsdfPrincipled", "Thin Film IOR"): (NOT, "named, and none"),
    ("ShaderNodeBsdfPrincipled", "Transmission Dispersion Scale"): (NOT, "named, and none"),
    ("ShaderNodeBsdfPrincipled", "Transmission Dispersion Abbe Number"): (NOT, "named, and none"),
    ("ShaderNodeBsdfPrincipled", "Thin Wall"): (APPROXIMATED, "named where light is transmitted: glass is solid"),
    ("ShaderNodeBsdfPrincipled", "Sheen Weight"): (APPROXIMATED, "up to 4 % off: a fit to Cycles' table"),
    ("ShaderNodeBsdfSheen", "Roughness"): (APPROXIMATED, "up to 4 % off: a fit to Cycles' table"),
    ("ShaderNodeBsdfGlass", "Thin Film Thickness"): (NOT, "named, and none"),
    ("ShaderNodeBsdfGlass", "Thin Film IOR"): (NOT, "named, and none"),
    ("ShaderNodeBsdfGlass", "Anisotropy"): (NOT, "named, and rough in every direction alike"),
    ("ShaderNodeBsdfGlass", "Rotation"): (NOT, "of anisotropy"),
    ("ShaderNodeBsdfGlass", "Tangent"): (NOT, "of anisotropy"),
    ("ShaderNodeBsdfMetallic", "Thin Film Thickness"): (NOT, "named, and none"),
    ("ShaderNodeBsdfMetallic", "Thin Film IOR"): (NOT, "named, and none"),
    ("ShaderNodeNewGeometry", "Parametric"): (NOT, NO_INPUT),
    ("ShaderNodeNewGeometry", "Pointiness"): (NOT, NO_INPUT),
    ("ShaderNodeNewGeometry", "Random Per Island"): (NOT, NO_INPUT),
}
"""Inputs and outputs, by their identifiers, that differ from their node."""


def decision(node: str) -> tuple[str, str] | None:
    """Status of a node by its `bl_idname`, with words where it is not equal; None if nobody has decided."""
    if node in NODES:
        return NODES[node]
    if node in ELSEWHERE or any(node in table for table in (TABLES.closures, TABLES.values, TABLES.volumes)):
        return EQUAL, ""
    return (NOT, COMPUTED) if node.startswith(COMPUTED_BY_BLENDER) else None
