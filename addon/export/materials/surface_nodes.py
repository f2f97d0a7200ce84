"""Nodes that tell of the surface around a point, of the ray that meets it and of the particle that shows it."""

from __future__ import annotations

from typing import Any

import bpy
from mathutils import Color

from ...core.color_matching import FIRST_NM, LAST_NM, X, Y, Z
from ..object_attributes import PARTICLE
from .graph import Source
from .translation import TranslateValue, Translation

WHITE = [1.0, 1.0, 1.0]
UNLIMITED = 1e30
"""Distance in metres that no ray exceeds."""
POINTINESS, ISLAND = "\tpointiness", "\trandom of island"
"""Names under which materials ask meshes for what nodes tell of their shape."""
OF_SHAPE = {"Pointiness": POINTINESS, "Random Per Island": ISLAND}
"""Names by the outputs of the node Geometry."""
GEOMETRY = {
    "Position": "position",
    "Normal": "normal",
    "Tangent": "tangent",
    "True Normal": "true_normal",
    "Incoming": "incoming",
    "Parametric": "parametric",
    "Backfacing": "backfacing",
}
RAYCAST_OUTPUTS = {"Is Hit", "Self Hit", "Hit Distance", "Hit Position", "Hit Normal"}
BRIGHTEST = 2.52
"""Largest component of Cycles' colours of wavelengths, which are divided by it."""


def geometry(t: Translation, source: Source) -> Any:
    """The node Geometry."""
    name = source.socket.identifier
    if name in OF_SHAPE:
        attribute = OF_SHAPE[name]
        if t.in_medium:
            return 0.0
        node = t.once(source, lambda: {"type": "attribute", "name": attribute}, attribute)
        return {"node": node, "output": "value"}
    if name == "Normal" and t.normal is not None:
        return t.normal
    return {"node": t.once(source, lambda: {"type": "geometry"}), "output": GEOMETRY[name]}


def _ambient_occlusion(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        distance = t.value(node, "Distance", source.context, 1.0)
        settings = {"samples": node.samples, "inside": node.inside, "only_local": node.only_local}
        return {
            "type": "ambient_occlusion",
            **settings,
            "color": t.value(node, "Color", source.context, WHITE),
            "distance": _distance_of_scene() if distance == 0.0 else distance,
            "normal": t.value(node, "Normal", source.context, None),
        }

    output = "color" if source.socket.identifier == "Color" else "factor"
    return {"node": t.once(source, description), "output": output}


def _distance_of_scene() -> float:
    """Distance of ambient occlusion where a node has none: that of the world where Fast GI is on, else unlimited."""
    scene = bpy.context.scene
    is_limited = scene.world is not None and getattr(getattr(scene, "cycles", None), "use_fast_gi", False)
    return float(scene.world.light_settings.distance) if is_limited else UNLIMITED


def _bevel(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        normal = t.value(node, "Normal", source.context, None)
        radius = t.value(node, "Radius", source.context, 0.05)
        normal = None if normal is t.normal else normal
        return {"type": "bevel", "samples": node.samples, "radius": radius, "normal": normal}

    return {"node": t.once(source, description), "output": "normal"}


def _raycast(t: Translation, source: Source) -> Any:
    node, asked = source.node, source.socket.identifier
    is_vector = source.socket.type == "VECTOR"
    if asked not in RAYCAST_OUTPUTS:
        t.warn(f"node '{node.name}': '{source.socket.name}' of what its ray meets is not known; taken as 0")
        return [0.0] * 3 if source.socket.type in {"VECTOR", "RGBA"} else 0.0

    def description() -> dict[str, Any]:
        direction = t.value(node, "Direction", source.context, None)
        return {
            "type": "raycast",
            "asked": asked.lower().replace(" ", "_"),
            "only_local": node.only_local,
            "position": t.value(node, "Position", source.context, None),
            "direction": t.normal if direction is None else direction,
            "length": t.value(node, "Length", source.context, 1.0),
        }

    return {"node": t.once(source, description, asked), "output": "vector" if is_vector else "value"}


def _tangent(t: Translation, source: Source) -> Any:
    node = source.node
    is_of_map = node.direction_type == "UV_MAP"
    settings = {"kind": "uv_map" if is_of_map else node.axis.lower(), "uv_map": node.uv_map if is_of_map else ""}
    return {"node": t.once(source, lambda: {"type": "tangent", **settings}), "output": "vector"}


def _wireframe(t: Translation, source: Source) -> Any:
    def description() -> dict[str, Any]:
        size = t.value(source.node, "Size", source.context, 0.01)
        return {"type": "wireframe", "in_pixels": source.node.use_pixel_size, "size": size}

    return {"node": t.once(source, description), "output": "value"}


def _particle_info(t: Translation, source: Source) -> Any:
    """Facts about the particle that shows an object, 0 of others."""
    output = "alpha" if source.socket.type == "VALUE" else "vector"
    return t.of_object(source, PARTICLE + source.socket.identifier, output)


def _wavelength(t: Translation, source: Source) -> Any:
    """Colour of light of one wavelength, black outside of what is visible; beyond sRGB it is cut."""
    step = (LAST_NM - FIRST_NM) / (len(X) - 1)

    def description() -> dict[str, Any]:
        table = [[0.0, 0.0, 0.0, 1.0]]
        for matched in zip(X, Y, Z, strict=True):
            color = Color(matched).from_xyz_d65_to_scene_linear()
            table.append([*(channel / BRIGHTEST for channel in color), 1.0])
        table.append(table[0])
        ends = {"min": FIRST_NM - step, "max": LAST_NM + step}
        curves = {"table": table, **ends, "interpolate": True, "extrapolate": False}
        nanometres = t.number(source.node, "Wavelength", source.context, 500.0)
        shown = t.emit({"type": "rgb_curves", "factor": 1.0, "color": nanometres, "curves": curves})
        inputs = {"a": {"node": shown, "output": "color"}, "b": [0.0] * 3, "c": [0.0] * 3, "scale": 1.0}
        return {"type": "vector_math", "operation": "MAXIMUM", **inputs}

    return {"node": t.once(source, description), "output": "color"}


def ies(t: Translation, source: Source) -> Any:
    """The strength that a photometric file gives to directions."""
    node = source.node

    def description() -> dict[str, Any]:
        border = "nearest" if bpy.app.version >= (5, 0, 0) else "zero"
        return {
            "type": "ies",
            "profile": {"text": _ies_text(node), "border": border},
            "strength": t.value(node, "Strength", source.context),
            "vector": t.value(node, "Vector", source.context, None),
        }

    return {"node": t.once(source, description), "output": "value"}


def _ies_text(node: bpy.types.Node) -> str:
    """Text of a photometric file; empty if there is none."""
    if node.mode == "INTERNAL":
        return node.ies.as_string() if node.ies is not None else ""
    try:
        with open(bpy.path.abspath(node.filepath, library=node.id_data.library), "rb") as file:
            return file.read().decode("utf-8", errors="replace")
    except OSError:
        return ""


def _light_falloff(t: Translation, source: Source) -> Any:
    """Strength by the length of the ray that meets the surface (Cycles' `svm_node_light_falloff`)."""
    node, context = source.node, source.context
    powers = {"Quadratic": 0, "Linear": 1, "Constant": 2}

    def math(operation: str, a: Any, b: Any) -> dict[str, Any]:
        number = t.emit({"type": "math", "operation": operation, "clamp": False, "a": a, "b": b, "c": 0.0})
        return {"node": number, "output": "value"}

    def value() -> Any:
        length = {"node": t.emit({"type": "light_path"}), "output": "ray_length"}
        strength, smooth = (t.value(node, name, context) for name in ("Strength", "Smooth"))
        for _ in range(powers[source.socket.identifier]):
            strength = math("MULTIPLY", strength, length)
        if smooth == 0.0:
            return strength
        squared = math("MULTIPLY", length, length)
        return math("MULTIPLY", strength, math("DIVIDE", squared, math("ADD", math("MAXIMUM", smooth, 0.0), squared)))

    return t.value_once(source, value, source.socket.identifier)


SURFACE_VALUES: dict[str, TranslateValue] = {
    "ShaderNodeNewGeometry": geometry,
    "ShaderNodeAmbientOcclusion": _ambient_occlusion,
    "ShaderNodeBevel": _bevel,
    "ShaderNodeRaycast": _raycast,
    "ShaderNodeTangent": _tangent,
    "ShaderNodeWireframe": _wireframe,
    "ShaderNodeParticleInfo": _particle_info,
    "ShaderNodeWavelength": _wavelength,
    "ShaderNodeLightFalloff": _light_falloff,
    "ShaderNodeTexIES": ies,
}
