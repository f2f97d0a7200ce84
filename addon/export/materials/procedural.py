"""Blender's procedural textures. Their formulas are the tracer's; here only their settings and sockets are read."""

from __future__ import annotations

from typing import Any

import bpy

from .coordinates import texture_vector
from .graph import IS_INLINED, Source
from .translation import TranslateValue, Translation

OUTPUTS = {
    "Fac": "factor",
    "Color": "color",
    "Value": "value",
    "Distance": "distance",
    "Position": "vector",
    "W": "w",
    "Radius": "radius",
}
"""The tracer's names of output sockets, by identifier."""


def _vector(t: Translation, source: Source, name: str, values: dict[str, Any]) -> Any:
    """Coordinates of a texture; None for its default."""
    if name == "white_noise":  # It takes none by itself.
        return t.value(source.node, "Vector", source.context, [0.0] * 3)
    own = t.value(source.node, "Vector", source.context, None)
    if _is_computed_by_blender(t, [own, *values.values()]):
        return own  # Blender leaves the mapping panel out.
    return texture_vector(t, source, {"type": "texture_coordinate", "kind": "generated"})


def _is_computed_by_blender(t: Translation, inputs: list[Any]) -> bool:
    """True for a texture at one place: Blender computes constants itself from 5.0 on, and not always as Cycles does."""
    return IS_INLINED and None not in inputs and all(map(t.is_constant, inputs))


def _correct_bricks(t: Translation, node: bpy.types.Node, values: dict[str, Any]) -> None:
    """Sees to numbers that make no bricks."""
    smooth = values["mortar_smooth"]
    if isinstance(smooth, float) and smooth < 0.0 and _is_computed_by_blender(t, list(values.values())):
        values["mortar_smooth"] = 0.0  # Cycles has no mortar then.
    if 0.0 in (values["brick_width"], values["row_height"]):
        t.warn(f"node '{node.name}': bricks of no width or height differ from Cycles; give them one")


def _texture(name: str, sockets: str, settings: dict[str, str]) -> TranslateValue:
    """A texture with the fields `sockets`, named like Blender's sockets, and `settings` as field -> attribute."""

    def translate(t: Translation, source: Source) -> Any:
        node, output = source.node, OUTPUTS[source.socket.identifier]
        # A Voronoi texture's position is a node of its own, since a node has four numbers.
        is_position = name == "voronoi" and output in {"vector", "w"}

        def description() -> dict[str, Any]:
            values = {field: getattr(node, attribute) for field, attribute in settings.items()}
            if name == "voronoi":
                values |= {"hash": "pcg" if bpy.app.version >= (5, 0, 0) else "jenkins", "position": is_position}
            elif name == "wave":
                values["direction"] = node.bands_direction if node.wave_type == "BANDS" else node.rings_direction
            for field in sockets.split():
                values[field] = t.value(node, field.replace("_", " ").title(), source.context)
            values["vector"] = _vector(t, source, name, values)
            if name == "brick":
                _correct_bricks(t, node, values)
            return {"type": "procedural", "texture": name, **values}

        return {"node": t.once(source, description, part="position" if is_position else ""), "output": output}

    return translate


def _gabor(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        sockets = {"orientation": "Orientation 2D", "direction": "Orientation 3D"}
        inputs = {socket.identifier: socket for socket in node.inputs}
        values = {field: t.socket_value(inputs[name], source.context) for field, name in sockets.items()}
        for field in ("scale", "frequency", "anisotropy"):
            values[field] = t.value(node, field.title(), source.context)
        values["vector"] = _vector(t, source, "gabor", values)
        return {"type": "procedural", "texture": "gabor", "dimensions": node.gabor_type, **values}

    output = {"Value": "x", "Phase": "y", "Intensity": "z"}[source.socket.identifier]
    return {"node": t.once(source, description), "output": output}


def _radial_tiling(t: Translation, source: Source) -> Any:
    node = source.node
    is_segment = source.socket.identifier in {"Segment Width", "Segment Rotation"}

    def description() -> dict[str, Any]:
        values = {field: t.value(node, field.title(), source.context) for field in ("sides", "roundness")}
        settings = {"normalize": node.normalize, "segment": is_segment}
        vector = t.value(node, "Vector", source.context, [0.0] * 3)
        if isinstance(vector, list):
            vector = [*vector, 0.0][:3]  # The socket has two numbers.
        return {"type": "procedural", "texture": "radial_tiling", **settings, **values, "vector": vector}

    outputs = {"Segment Coordinates": "vector", "Segment ID": "w", "Segment Width": "x", "Segment Rotation": "y"}
    number = t.once(source, description, part="segment" if is_segment else "")
    return {"node": number, "output": outputs[source.socket.identifier]}


TEXTURES: dict[str, TranslateValue] = {
    "ShaderNodeTexNoise": _texture(
        "noise",
        "w scale detail roughness lacunarity offset gain distortion",
        {"dimensions": "noise_dimensions", "kind": "noise_type", "normalize": "normalize"},
    ),
    "ShaderNodeTexWhiteNoise": _texture("white_noise", "w", {"dimensions": "noise_dimensions"}),
    "ShaderNodeTexChecker": _texture("checker", "color1 color2 scale", {}),
    "ShaderNodeTexGradient": _texture("gradient", "", {"kind": "gradient_type"}),
    "ShaderNodeTexVoronoi": _texture(
        "voronoi",
        "w scale detail roughness lacunarity smoothness exponent randomness",
        {
            "dimensions": "voronoi_dimensions",
            "feature": "feature",
            "metric": "distance",
            "normalize": "normalize",
        },
    ),
    "ShaderNodeTexWave": _texture(
        "wave",
        "scale distortion detail detail_scale detail_roughness phase_offset",
        {"kind": "wave_type", "profile": "wave_profile"},
    ),
    "ShaderNodeTexGabor": _gabor,
    "ShaderNodeRadialTiling": _radial_tiling,
    "ShaderNodeTexMagic": _texture("magic", "scale distortion", {"depth": "turbulence_depth"}),
    "ShaderNodeTexBrick": _texture(
        "brick",
        "color1 color2 mortar scale mortar_size mortar_smooth bias brick_width row_height",
        {
            "offset": "offset",
            "offset_frequency": "offset_frequency",
            "squash": "squash",
            "squash_frequency": "squash_frequency",
        },
    ),
}
