"""Closure nodes of media. Each function translates one node and returns its number."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.blackbody import COLDEST_K, HOTTEST_K, blackbody_fit
from ..working_space import scene_linear_from_rec709
from .closures import ADD, EMISSION, MIX
from .graph import Context, Source, trace
from .translation import TranslateClosure, Translation

BLACK, GREY, WHITE = [0.0] * 3, [0.5] * 3, [1.0] * 3
SMALLEST_DROPLET = 5.0 if bpy.app.version < (4, 4, 0) else 0.0
"""Diameter in micrometres of the smallest droplets that this Blender's Mie scattering knows."""
BLACKBODY_ENTRIES = 449
"""Colours of black bodies in steps of 25 K."""

# Blender's `phase`, our name and its fields with sockets and values where there is none.
PHASES: dict[str, tuple[str, tuple[tuple[str, str, float], ...]]] = {
    "HENYEY_GREENSTEIN": ("henyey_greenstein", (("anisotropy", "Anisotropy", 0.0),)),
    "FOURNIER_FORAND": ("fournier_forand", (("ior", "IOR", 1.33), ("backscatter", "Backscatter", 0.1))),
    "DRAINE": ("draine", (("anisotropy", "Anisotropy", 0.0), ("alpha", "Alpha", 0.5))),
    "RAYLEIGH": ("rayleigh", ()),
    "MIE": ("mie", (("diameter", "Diameter", 20.0),)),
}


def _phase(t: Translation, node: bpy.types.Node, context: Context) -> dict[str, Any]:
    """The phase function of a node; before Blender 4.3 there is one alone."""
    kind = getattr(node, "phase", "HENYEY_GREENSTEIN")
    if kind not in PHASES:
        t.warn(f"node '{node.name}': phase function {kind} is not supported; taken as Henyey-Greenstein")
        kind = "HENYEY_GREENSTEIN"
    name, sockets = PHASES[kind]
    fields = {field: t.value(node, socket, context, default) for field, socket, default in sockets}
    if kind == "MIE" and SMALLEST_DROPLET > 0.0:
        fields["diameter"] = _at_least(t, fields["diameter"], SMALLEST_DROPLET)
    return {"type": name, **fields}


def _at_least(t: Translation, value: Any, least: float) -> Any:
    if not isinstance(value, dict):
        return max(value, least)
    inputs = {"a": value, "b": least, "c": 0.0}
    return {"node": t.emit({"type": "math", "operation": "MAXIMUM", "clamp": False, **inputs}), "output": "value"}


def _scatter(t: Translation, node: bpy.types.Node, context: Context) -> int:
    color, density = t.value(node, "Color", context), t.value(node, "Density", context)
    return t.emit({"type": "volume_scatter", "color": color, "density": density, "phase": _phase(t, node, context)})


def _absorption(t: Translation, node: bpy.types.Node, context: Context) -> int:
    color, density = t.value(node, "Color", context), t.value(node, "Density", context)
    return t.emit({"type": "volume_absorption", "color": color, "density": density})


def _coefficients(t: Translation, node: bpy.types.Node, context: Context) -> int:
    """The node since Blender 4.5 whose coefficients are given themselves."""
    fields = {
        field: t.value(node, f"{name} Coefficients", context, default)
        for field, name, default in (
            ("absorption", "Absorption", WHITE),
            ("scatter", "Scatter", WHITE),
            ("emission", "Emission", BLACK),
        )
    }
    return t.emit({"type": "volume_coefficients", **fields, "phase": _phase(t, node, context)})


def _principled(t: Translation, node: bpy.types.Node, context: Context) -> int:
    sockets = (
        ("color", "Color", GREY),
        ("density", "Density", 1.0),
        ("anisotropy", "Anisotropy", 0.0),
        ("absorption_color", "Absorption Color", BLACK),
        ("emission_strength", "Emission Strength", 0.0),
        ("emission_color", "Emission Color", WHITE),
        ("blackbody_intensity", "Blackbody Intensity", 0.0),
        ("blackbody_tint", "Blackbody Tint", WHITE),
        ("temperature", "Temperature", 1000.0),
    )
    fields = {field: t.value(node, socket, context, default) for field, socket, default in sockets}
    names = {
        f"{field}_attribute": _text(node, f"{field.title()} Attribute", context)
        for field in ("color", "density", "temperature")
    }
    colors = None if fields["blackbody_intensity"] == 0.0 else blackbody_colors()
    return t.emit({"type": "principled_volume", **fields, **names, "blackbody": colors})


def _text(node: bpy.types.Node, socket: str, context: Context) -> str:
    """The text of a socket, which the group around may have."""
    found = trace(node.inputs[socket], context) if socket in node.inputs else None
    if found is None or isinstance(found, Source):
        return ""
    value = getattr(found.owner, "default_value", "")
    return value if isinstance(value, str) else ""


def blackbody_colors() -> dict[str, Any]:
    """Colours of black bodies in the file's working space, over their temperature."""
    turn = scene_linear_from_rec709()
    step = (HOTTEST_K - COLDEST_K) / (BLACKBODY_ENTRIES - 1)
    table = [[*(turn @ blackbody_fit(COLDEST_K + i * step)).tolist(), 1.0] for i in range(BLACKBODY_ENTRIES)]
    return {"min": COLDEST_K, "max": HOTTEST_K, "table": table, "interpolate": True, "extrapolate": False}


DEFAULT_VOLUME: dict[str, Any] = {
    "name": "\tVolume",
    "surface": None,
    "volume": 0,
    "nodes": [
        {
            "type": "principled_volume",
            "color": GREY,
            "color_attribute": "",
            "density": 1.0,
            "density_attribute": "density",
            "anisotropy": 0.0,
            "absorption_color": BLACK,
            "emission_strength": 0.0,
            "emission_color": WHITE,
            "blackbody_intensity": 0.0,
            "blackbody_tint": WHITE,
            "blackbody": None,
            "temperature": 1000.0,
            "temperature_attribute": "temperature",
        }
    ],
}
"""Cycles' material for volume objects without one. No material in a file can have its name."""

VOLUMES: dict[str, TranslateClosure] = {
    "ShaderNodeVolumeScatter": _scatter,
    "ShaderNodeVolumeAbsorption": _absorption,
    "ShaderNodeVolumeCoefficients": _coefficients,
    "ShaderNodeVolumePrincipled": _principled,
    "ShaderNodeEmission": EMISSION,
    "ShaderNodeMixShader": MIX,
    "ShaderNodeAddShader": ADD,
}
"""Closures that count in a volume; surfaces there do nothing, as in Cycles."""
