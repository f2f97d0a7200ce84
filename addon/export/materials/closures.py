"""Closure nodes. Each function translates one node and returns its number."""

from __future__ import annotations

from typing import Any

import bpy

from ..working_space import LINEAR_REC709, working_space
from .dispersion import dispersion
from .graph import Context
from .subsurface import subsurface
from .translation import TranslateClosure, Translation

WHITE = [1.0, 1.0, 1.0]

ROUGH_REFRACTION = 0.6
"""Roughness up to which refraction is as bright as in Cycles to some 2 %."""

ANISOTROPIC_GLASS = bpy.app.version >= (5, 3, 0)
"""True if what Principled transmits is anisotropic, too."""

MULTIPLE_SCATTERING = "full" if bpy.app.version >= (5, 3, 0) else "dimmed"
"""Colour of what rough diffuse surfaces scatter more than once."""

# JSON field, socket name, value where this Blender has no such socket.
PRINCIPLED = (
    ("base_color", "Base Color", [0.8, 0.8, 0.8]),
    ("metallic", "Metallic", 0.0),
    ("roughness", "Roughness", 0.5),
    ("diffuse_roughness", "Diffuse Roughness", 0.0),
    ("ior", "IOR", 1.5),
    ("alpha", "Alpha", 1.0),
    ("normal", "Normal", None),
    ("subsurface_weight", "Subsurface Weight", 0.0),
    ("specular_ior_level", "Specular IOR Level", 0.5),
    ("specular_tint", "Specular Tint", WHITE),
    ("anisotropic", "Anisotropic", 0.0),
    ("anisotropic_rotation", "Anisotropic Rotation", 0.0),
    ("tangent", "Tangent", None),
    ("transmission_weight", "Transmission Weight", 0.0),
    ("coat_weight", "Coat Weight", 0.0),
    ("coat_roughness", "Coat Roughness", 0.03),
    ("coat_ior", "Coat IOR", 1.5),
    ("coat_tint", "Coat Tint", WHITE),
    ("coat_normal", "Coat Normal", None),
    ("sheen_weight", "Sheen Weight", 0.0),
    ("sheen_roughness", "Sheen Roughness", 0.5),
    ("sheen_tint", "Sheen Tint", WHITE),
    ("emission_color", "Emission Color", WHITE),
    ("emission_strength", "Emission Strength", 0.0),
)


def _principled(t: Translation, node: bpy.types.Node, context: Context) -> int:
    fields = {field: t.value(node, socket, context, default) for field, socket, default in PRINCIPLED}
    if fields["diffuse_roughness"] != 0.0:
        fields["multiple_scattering"] = MULTIPLE_SCATTERING
    if fields["subsurface_weight"] != 0.0:
        fields["subsurface"] = subsurface(t, node, context, node.subsurface_method, "Subsurface ")
    fields |= _film(t, node, context)
    if ANISOTROPIC_GLASS and fields["anisotropic"] != 0.0:
        fields["anisotropic_glass"] = True
    thin_wall = t.value(node, "Thin Wall", context, 0.0)
    if fields["transmission_weight"] != 0.0 and thin_wall == 0.0:
        _warn_of_rough_refraction(t, node, context)
    if thin_wall != 0.0 and (fields["subsurface_weight"] != 0.0 or fields["transmission_weight"] != 0.0):
        fields["thin_wall"] = thin_wall
    if fields["transmission_weight"] != 0.0:
        fields |= dispersion(t, node, context)
    return t.emit({"type": "principled", **fields, "distribution": distribution(t, node)})


def _warn_of_rough_refraction(t: Translation, node: bpy.types.Node, context: Context) -> None:
    """Warns of rough refraction. Cycles' light samples reach directions that its own rays never take, the more the
    rougher it is; the difference depends on the light."""
    roughness = t.value(node, "Roughness", context)
    if isinstance(roughness, float) and roughness > ROUGH_REFRACTION:
        t.warn(f"node '{node.name}': refraction this rough is up to a tenth brighter in Cycles, by lamps behind it")


def _film(t: Translation, node: bpy.types.Node, context: Context) -> dict[str, Any]:
    """The thin film of a node as a field of the JSON form; none if it has no thickness."""
    thickness = t.value(node, "Thin Film Thickness", context, 0.0)
    if thickness == 0.0:
        return {}
    is_new = bpy.app.version >= (5, 0, 0)
    if working_space() != LINEAR_REC709:
        t.warn(f"node '{node.name}': the colours of its thin film are those of {LINEAR_REC709}")
    ior = t.value(node, "Thin Film IOR", context, 1.33)
    model = {"model": "tabulated" if is_new else "fitted", "on_metal": is_new}
    return {"film": {"thickness": thickness, "ior": ior, **model}}


def distribution(t: Translation, node: bpy.types.Node) -> str:
    """The microfacet distribution of a node."""
    known = {"GGX": "ggx", "MULTI_GGX": "multi_ggx", "BECKMANN": "beckmann", "ASHIKHMIN_SHIRLEY": "ashikhmin_shirley"}
    name = getattr(node, "distribution", "GGX")
    if name not in known:
        t.warn(f"node '{node.name}': distribution {name} is not supported; taken as GGX")
    return known.get(name, "ggx")


def _simple(kind: str, *fields: tuple[str, str, Any], microfacet: bool = False, **properties: str) -> TranslateClosure:
    """A closure whose fields are sockets, and properties."""

    def translate(t: Translation, node: bpy.types.Node, context: Context) -> int:
        values = {field: t.value(node, socket, context, default) for field, socket, default in fields}
        extra = {"distribution": distribution(t, node)} if microfacet else {}
        return t.emit({"type": kind, **properties, **values, **extra})

    return translate


EMISSION = _simple("emission", ("color", "Color", WHITE), ("strength", "Strength", 1.0))
COLOR = ("color", "Color", [0.8, 0.8, 0.8])
NORMAL = ("normal", "Normal", None)
ROUGHNESS = ("roughness", "Roughness", 0.0)
IOR = ("ior", "IOR", 1.5)
ANISOTROPY = (
    ("anisotropy", "Anisotropy", 0.0),
    ("rotation", "Rotation", 0.0),
    NORMAL,
    ("tangent", "Tangent", None),
)


def _mix(t: Translation, node: bpy.types.Node, context: Context) -> int:
    factor = t.value(node, 0, context, 0.5)
    a, b = t.shader(node.inputs[1], context), t.shader(node.inputs[2], context)
    return t.emit({"type": "mix_shader", "factor": factor, "a": a, "b": b})


def _add(t: Translation, node: bpy.types.Node, context: Context) -> int:
    a, b = t.shader(node.inputs[0], context), t.shader(node.inputs[1], context)
    return t.emit({"type": "add_shader", "a": a, "b": b})


MIX: TranslateClosure = _mix
ADD: TranslateClosure = _add


def _diffuse(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    color, normal = t.value(node, "Color", context, [0.8, 0.8, 0.8]), t.value(node, "Normal", context, None)
    roughness = t.value(node, "Roughness", context, 0.0)
    fields = {"type": "diffuse", "color": color, "roughness": roughness, "normal": normal}
    if roughness != 0.0:
        loses = bpy.app.version < (4, 3, 0)
        fields |= {"type": "single_scattering_diffuse"} if loses else {"multiple_scattering": MULTIPLE_SCATTERING}
    return t.emit(fields)


def _subsurface(t: Translation, node: bpy.types.Node, context: Context) -> int:
    color, normal = t.value(node, "Color", context, [0.8, 0.8, 0.8]), t.value(node, "Normal", context, None)
    roughness, body = t.value(node, "Roughness", context, 1.0), subsurface(t, node, context, node.falloff)
    fields = {"color": color, "roughness": roughness, "normal": normal, "subsurface": body}
    return t.emit({"type": "subsurface_scattering", **fields})


def _nothing(_t: Translation, _node: bpy.types.Node, _context: Context) -> None:
    return None


def _glass(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    _warn_of_rough_refraction(t, node, context)
    fields = (COLOR, ROUGHNESS, IOR, NORMAL)
    values = {field: t.value(node, socket, context, default) for field, socket, default in fields}
    if (anisotropy := t.value(node, "Anisotropy", context, 0.0)) != 0.0:
        rotation, tangent = t.value(node, "Rotation", context, 0.0), t.value(node, "Tangent", context, None)
        values |= {"anisotropy": anisotropy, "rotation": rotation, "tangent": tangent}
    return t.emit({"type": "glass", **values, **_film(t, node, context), "distribution": distribution(t, node)})


def _refraction(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    _warn_of_rough_refraction(t, node, context)
    return _simple("refraction", COLOR, ROUGHNESS, IOR, NORMAL, microfacet=True)(t, node, context)


def _metallic(t: Translation, node: bpy.types.Node, context: Context) -> int:
    fields = (
        ("base_color", "Base Color", [0.617, 0.577, 0.540]),
        ("edge_tint", "Edge Tint", [0.695, 0.726, 0.770]),
        ("ior", "IOR", [2.757, 2.513, 2.231]),
        ("extinction", "Extinction", [3.867, 3.404, 3.009]),
        ROUGHNESS,
        *ANISOTROPY,
    )
    values = {field: t.value(node, socket, context, default) for field, socket, default in fields}
    kinds = {"fresnel": node.fresnel_type.lower(), "distribution": distribution(t, node)}
    return t.emit({"type": "metallic", **kinds, **values, **_film(t, node, context)})


def _sheen(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    return _simple("sheen", COLOR, ("roughness", "Roughness", 0.5), NORMAL, model=node.distribution.lower())(
        t, node, context
    )


def _toon(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    fields = (COLOR, ("size", "Size", 0.5), ("smooth", "Smooth", 0.0), NORMAL)
    return _simple("toon", *fields, component=node.component.lower())(t, node, context)


CLOSURES: dict[str, TranslateClosure] = {
    "ShaderNodeBsdfPrincipled": _principled,
    "ShaderNodeBsdfDiffuse": _diffuse,
    "ShaderNodeBsdfAnisotropic": _simple("glossy", COLOR, ROUGHNESS, *ANISOTROPY, microfacet=True),
    "ShaderNodeBsdfMetallic": _metallic,
    "ShaderNodeBsdfSheen": _sheen,
    "ShaderNodeBsdfToon": _toon,
    "ShaderNodeBsdfGlass": _glass,
    "ShaderNodeBsdfRefraction": _refraction,
    "ShaderNodeBsdfTranslucent": _simple("translucent", COLOR, NORMAL),
    "ShaderNodeBsdfRayPortal": _simple(
        "ray_portal", ("color", "Color", WHITE), ("position", "Position", None), ("direction", "Direction", [0.0] * 3)
    ),
    "ShaderNodeBsdfTransparent": _simple("transparent", ("color", "Color", WHITE)),
    "ShaderNodeSubsurfaceScattering": _subsurface,
    "ShaderNodeHoldout": _simple("holdout"),
    "ShaderNodeEmission": EMISSION,
    "ShaderNodeBackground": EMISSION,
    "ShaderNodeMixShader": MIX,
    "ShaderNodeAddShader": ADD,
    # Media have no surface.
    "ShaderNodeVolumePrincipled": _nothing,
    "ShaderNodeVolumeScatter": _nothing,
    "ShaderNodeVolumeAbsorption": _nothing,
    "ShaderNodeVolumeCoefficients": _nothing,
}
