"""Value nodes: textures, coordinates, colour and maths. Each function translates the node of a source and returns a
link `{"node", "output"}` or a constant."""

from __future__ import annotations

from typing import Any

from ..object_attributes import OF_INSTANCER
from .attribute_nodes import ATTRIBUTE_VALUES
from .function_nodes import FUNCTION_VALUES
from .graph import IS_INLINED, Source, convert
from .image_nodes import IMAGE_VALUES
from .point_density import POINT_VALUES
from .procedural import TEXTURES
from .surface_nodes import SURFACE_VALUES
from .tables import color_ramp, float_curve, rgb_curves, rgb_curves_at
from .translation import SURFACE_BEFORE, TranslateValue, Translation
from .vectors import VECTOR_VALUES, transformed

Field = tuple[str, str | int, Any]

ANY_UV_MAP = "\tUV map"
"""Name under which a normal map asks for the first UV map."""
UP = [0.0, 0.0, 1.0]


def _simple(
    kind: str, output: str, *fields: Field, properties: dict[str, tuple[str, Any]] | None = None
) -> TranslateValue:
    """A node whose fields are sockets, and properties given as field -> (attribute, conversion)."""

    def translate(t: Translation, source: Source) -> Any:
        node = source.node

        def description() -> dict[str, Any]:
            values = {field: t.value(node, socket, source.context, default) for field, socket, default in fields}
            settings = {
                field: convert(getattr(node, attribute)) for field, (attribute, convert) in (properties or {}).items()
            }
            return {"type": kind, **settings, **values}

        return {"node": t.once(source, description), "output": output}

    return translate


def _outputs(translate: TranslateValue, names: dict[str, str]) -> TranslateValue:
    """Translation of the same node with an output of its own for each socket identifier."""

    def with_output(t: Translation, source: Source) -> Any:
        return {**translate(t, source), "output": names[source.socket.identifier]}

    return with_output


def _texture_coordinate(t: Translation, source: Source) -> Any:
    node, kind = source.node, source.socket.identifier.lower()
    if node.from_instancer and kind in OF_INSTANCER:
        return t.of_object(source, OF_INSTANCER[kind], "vector")
    if node.object is not None and kind == "object":
        position = {"node": t.once(source, lambda: {"type": "geometry"}, "position"), "output": "position"}
        return t.value_once(source, lambda: transformed(t, position, node.object.matrix_world.inverted_safe()))
    return {"node": t.emit({"type": "texture_coordinate", "kind": kind}), "output": "vector"}


def _mix(t: Translation, source: Source) -> Any:
    """The Mix node: which sockets count depends on its data type."""
    node = source.node
    suffix, output = {"FLOAT": ("Float", "value"), "VECTOR": ("Vector", "vector"), "RGBA": ("Color", "color")}.get(
        node.data_type, ("Color", "color")
    )
    if node.data_type not in {"FLOAT", "VECTOR", "RGBA"}:
        t.warn(f"node '{node.name}': mixing of {node.data_type.lower()} is not supported; taken as black")
        return [0.0, 0.0, 0.0]
    per_component = node.data_type == "VECTOR" and node.factor_mode == "NON_UNIFORM"
    data = "vector_non_uniform" if per_component else output.replace("value", "float")

    def socket(identifier: str) -> Any:
        target = next(socket for socket in node.inputs if socket.identifier == identifier)
        return t.socket_value(target, source.context)

    def description() -> dict[str, Any]:
        return {
            "type": "mix",
            "data": data,
            "blend": node.blend_type if node.data_type == "RGBA" else "MIX",
            "clamp_factor": node.clamp_factor,
            "clamp_result": node.clamp_result and node.data_type == "RGBA",
            "factor": socket("Factor_Vector" if per_component else "Factor_Float"),
            "a": socket(f"A_{suffix}"),
            "b": socket(f"B_{suffix}"),
        }

    return {"node": t.once(source, description), "output": output}


def _mix_rgb(t: Translation, source: Source) -> Any:
    """The Mix node of files saved before Blender 3.4."""
    node = source.node

    def description() -> dict[str, Any]:
        factor, a, b = (t.value(node, index, source.context) for index in range(3))
        settings = {"blend": node.blend_type, "clamp_factor": True, "clamp_result": node.use_clamp}
        return {"type": "mix", "data": "color", **settings, "factor": factor, "a": a, "b": b}

    return {"node": t.once(source, description), "output": "color"}


VECTOR_OPERATIONS = {
    *("ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD", "CROSS_PRODUCT", "PROJECT", "REFLECT"),
    *("DOT_PRODUCT", "DISTANCE", "LENGTH", "SCALE", "NORMALIZE", "ABSOLUTE", "MINIMUM", "MAXIMUM", "FLOOR"),
    *("CEIL", "FRACTION", "MODULO", "SNAP", "SINE", "COSINE", "TANGENT", "WRAP", "FACEFORWARD", "REFRACT"),
    *("SIGN", "POWER", "ROUND"),
}


def _vector_math(t: Translation, source: Source) -> Any:
    node = source.node
    if node.operation not in VECTOR_OPERATIONS:
        t.warn(f"node '{node.name}': operation {node.operation.lower()} is not supported yet; its first input is used")
        return t.value(node, 0, source.context)

    def description() -> dict[str, Any]:
        a, b, c = (t.value(node, index, source.context) for index in range(3))
        scale = t.value(node, "Scale", source.context, 1.0)
        return {"type": "vector_math", "operation": node.operation, "a": a, "b": b, "c": c, "scale": scale}

    output = "value" if source.socket.identifier == "Value" else "vector"
    return {"node": t.once(source, description), "output": output}


def _map_range(t: Translation, source: Source) -> Any:
    """The Map Range node; a vector becomes one node for each component."""
    node = source.node
    names = ("value", "from_min", "from_max", "to_min", "to_max", "steps")
    settings = {"type": "map_range", "interpolation": node.interpolation_type, "clamp": node.clamp}

    def number() -> dict[str, Any]:
        inputs = {name: t.value(node, index, source.context) for index, name in enumerate(names)}
        # Blender, which computes constants itself from 5.0 on, has another result for a range of no width than Cycles.
        return {**settings, "empty_gives_min": IS_INLINED and all(map(t.is_constant, inputs.values())), **inputs}

    def vector() -> dict[str, Any]:
        inputs = {name: t.value(node, 6 + index, source.context) for index, name in enumerate(names)}
        parts = {name: _components(t, value) for name, value in inputs.items()}
        mapped = (
            t.emit({**settings, "empty_gives_min": True, **{name: part[axis] for name, part in parts.items()}})
            for axis in range(3)
        )
        return {"type": "combine_xyz"} | {
            axis: {"node": number, "output": "value"} for axis, number in zip("xyz", mapped, strict=True)
        }

    if node.data_type == "FLOAT":
        return {"node": t.once(source, number), "output": "value"}
    return {"node": t.once(source, vector), "output": "vector"}


def _components(t: Translation, value: Any) -> list[Any]:
    """X, y and z of an input."""
    if isinstance(value, list):
        return value
    if not isinstance(value, dict):
        return [value] * 3
    separate = t.emit({"type": "separate_xyz", "vector": value})
    return [{"node": separate, "output": axis} for axis in "xyz"]


def _separate(mode: str | None, *names: str) -> TranslateValue:
    """Separate nodes: the color models of old and new ones, and their output sockets in order."""

    def translate(t: Translation, source: Source) -> Any:
        def description() -> dict[str, Any]:
            color = t.value(source.node, 0, source.context)
            return {"type": "separate_color", "mode": mode or source.node.mode.lower(), "color": color}

        return {"node": t.once(source, description), "output": "xyz"[names.index(source.socket.identifier)]}

    return translate


def _combine(mode: str | None) -> TranslateValue:
    def translate(t: Translation, source: Source) -> Any:
        def description() -> dict[str, Any]:
            a, b, c = (t.value(source.node, index, source.context) for index in range(3))
            return {"type": "combine_color", "mode": mode or source.node.mode.lower(), "a": a, "b": b, "c": c}

        return {"node": t.once(source, description), "output": "color"}

    return translate


def _object_info(t: Translation, source: Source) -> Any:
    outputs = {
        "Location": "location",
        "Color": "color",
        "Alpha": "alpha",
        "Object Index": "object_index",
        "Random": "random",
    }
    name = outputs[source.socket.identifier]
    return {"node": t.once(source, lambda: {"type": "object_info"}), "output": name}


def _light_path(t: Translation, source: Source) -> Any:
    name = source.socket.identifier
    return {"node": t.once(source, lambda: {"type": "light_path"}), "output": name.lower().replace(" ", "_")}


def _color_ramp(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        factor = t.value(node, 0, source.context, 0.5)
        return {"type": "color_ramp", "factor": factor, "ramp": color_ramp(node.color_ramp)}

    output = "alpha" if source.socket.identifier == "Alpha" else "color"
    return {"node": t.once(source, description), "output": output}


def _rgb_curves(t: Translation, source: Source) -> Any:
    node = source.node

    def value() -> Any:
        factor, color = t.value(node, 0, source.context, 1.0), t.value(node, 1, source.context)
        # Blender computes constants itself from 5.0 on. It knows curves beyond their ends, of which Cycles has a table.
        if IS_INLINED and isinstance(factor, float) and isinstance(color, list) and t.is_constant(color):
            curved = rgb_curves_at(node.mapping, color)
            return [before + factor * (after - before) for before, after in zip(color, curved, strict=True)]
        curves = rgb_curves(node.mapping)
        return {
            "node": t.emit({"type": "rgb_curves", "factor": factor, "color": color, "curves": curves}),
            "output": "color",
        }

    return t.value_once(source, value)


def _float_curve(t: Translation, source: Source) -> Any:
    """A curve of one value is a grey RGB curve."""
    node = source.node

    def description() -> dict[str, Any]:
        factor, value = t.value(node, 0, source.context, 1.0), t.number(node, 1, source.context)
        return {"type": "rgb_curves", "factor": factor, "color": value, "curves": float_curve(node.mapping)}

    return {"node": t.once(source, description), "output": "color"}


def _normal_map(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        color = t.value(node, "Color", source.context, [0.5, 0.5, 1.0])
        if getattr(node, "convention", "OPENGL") == "DIRECTX":  # From Blender 5.2 on: green points down, in all spaces.
            color = _with_green_flipped(t, color)
        strength = t.value(node, "Strength", source.context, 1.0)
        settings = {"space": node.space.lower(), "uv_map": node.uv_map}
        if IS_INLINED and settings == {"space": "tangent", "uv_map": ""}:
            t.attributes[ANY_UV_MAP] = node.name  # Before Blender 5.0 it is known what Cycles takes without one.
        is_plain = t.displacement is None or getattr(node, "base", "ORIGINAL") == "DISPLACED"
        base = "shaded" if is_plain else SURFACE_BEFORE
        return {"type": "normal_map", **settings, "strength": strength, "color": color, "base": base}

    return {"node": t.once(source, description), "output": "normal"}


def _with_green_flipped(t: Translation, color: Any) -> Any:
    """A colour with 1 - green in the place of green."""
    if isinstance(color, list):
        return [color[0], 1.0 - color[1], color[2]]
    inputs = {"a": color, "b": [1.0, -1.0, 1.0], "c": [0.0, 1.0, 0.0], "scale": 1.0}
    return {"node": t.emit({"type": "vector_math", "operation": "MULTIPLY_ADD", **inputs}), "output": "vector"}


def _bump(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        fields = (
            ("strength", "Strength", 1.0),
            ("distance", "Distance", 1.0),
            ("height", "Height", 1.0),
            ("normal", "Normal", None),
        )
        values = {field: t.value(node, socket, source.context, default) for field, socket, default in fields}
        if all(not isinstance(values[field], dict) or t.is_constant(values[field]) for field in ("height", "normal")):
            values["normal"] = t.normal  # Without height Cycles passes on what is linked to the normal, if that varies.
        if "Filter Width" in node.inputs:
            values["filter_width"] = t.value(node, "Filter Width", source.context)
        return {"type": "bump", "invert": node.invert, **values}

    return {"node": t.once(source, description), "output": "normal"}


def _rgb_to_bw(t: Translation, source: Source) -> Any:
    """The implicit conversion from colour to float, made explicit by adding nothing."""

    def description() -> dict[str, Any]:
        color = t.value(source.node, 0, source.context)
        value = t.as_color(color) if isinstance(color, dict) else convert(color, "RGBA", "VALUE")
        return {"type": "math", "operation": "ADD", "clamp": False, "a": value, "b": 0.0, "c": 0.0}

    return {"node": t.once(source, description), "output": "value"}


VALUES: dict[str, TranslateValue] = {
    **IMAGE_VALUES,
    **POINT_VALUES,
    **ATTRIBUTE_VALUES,
    **TEXTURES,
    **VECTOR_VALUES,
    **SURFACE_VALUES,
    **FUNCTION_VALUES,
    "ShaderNodeTexCoord": _texture_coordinate,
    "ShaderNodeMapping": _simple(
        "mapping",
        "vector",
        ("vector", "Vector", [0.0] * 3),
        ("location", "Location", [0.0] * 3),
        ("rotation", "Rotation", [0.0] * 3),
        ("scale", "Scale", [1.0] * 3),
        properties={"kind": ("vector_type", str.lower)},
    ),
    "ShaderNodeDisplacement": _simple(
        "displacement",
        "vector",
        ("height", "Height", 0.0),
        ("midlevel", "Midlevel", 0.5),
        ("scale", "Scale", 1.0),
        ("normal", "Normal", None),
        properties={"world_space": ("space", lambda space: space == "WORLD")},
    ),
    "ShaderNodeVectorDisplacement": _simple(
        "vector_displacement",
        "vector",
        ("vector", "Vector", [0.8] * 3),
        ("midlevel", "Midlevel", 0.0),
        ("scale", "Scale", 1.0),
        properties={"space": ("space", str.lower)},
    ),
    "ShaderNodeNormalMap": _normal_map,
    "ShaderNodeBump": _bump,
    "ShaderNodeMix": _mix,
    "ShaderNodeMixRGB": _mix_rgb,
    "ShaderNodeMath": _simple(
        "math",
        "value",
        ("a", 0, 0.0),
        ("b", 1, 0.0),
        ("c", 2, 0.0),
        properties={"operation": ("operation", str), "clamp": ("use_clamp", bool)},
    ),
    "ShaderNodeVectorMath": _vector_math,
    "ShaderNodeMapRange": _map_range,
    "ShaderNodeClamp": _simple(
        "clamp",
        "value",
        ("value", "Value", 0.0),
        ("min", "Min", 0.0),
        ("max", "Max", 1.0),
        properties={"range": ("clamp_type", lambda kind: kind == "RANGE")},
    ),
    "ShaderNodeValToRGB": _color_ramp,
    "ShaderNodeRGBCurve": _rgb_curves,
    "ShaderNodeFloatCurve": _float_curve,
    "ShaderNodeHueSaturation": _simple(
        "hue_saturation",
        "color",
        ("hue", "Hue", 0.5),
        ("saturation", "Saturation", 1.0),
        ("value", "Value", 1.0),
        ("factor", 3, 1.0),
        ("color", "Color", [0.8] * 3),
    ),
    "ShaderNodeBrightContrast": _simple(
        "bright_contrast", "color", ("color", "Color", [1.0] * 3), ("bright", 1, 0.0), ("contrast", "Contrast", 0.0)
    ),
    "ShaderNodeGamma": _simple("gamma", "color", ("color", "Color", [1.0] * 3), ("gamma", "Gamma", 1.0)),
    "ShaderNodeInvert": _simple("invert", "color", ("factor", 0, 1.0), ("color", "Color", [0.0] * 3)),
    "ShaderNodeRGBToBW": _rgb_to_bw,
    "ShaderNodeSeparateColor": _separate(None, "Red", "Green", "Blue"),
    "ShaderNodeSeparateRGB": _separate("rgb", "R", "G", "B"),
    "ShaderNodeSeparateHSV": _separate("hsv", "H", "S", "V"),
    "ShaderNodeCombineColor": _combine(None),
    "ShaderNodeCombineRGB": _combine("rgb"),
    "ShaderNodeCombineHSV": _combine("hsv"),
    "ShaderNodeSeparateXYZ": _outputs(
        _simple("separate_xyz", "x", ("vector", "Vector", [0.0] * 3)), {"X": "x", "Y": "y", "Z": "z"}
    ),
    "ShaderNodeCombineXYZ": _simple("combine_xyz", "vector", ("x", "X", 0.0), ("y", "Y", 0.0), ("z", "Z", 0.0)),
    "ShaderNodeFresnel": _simple("fresnel", "value", ("ior", "IOR", 1.5), ("normal", "Normal", None)),
    "ShaderNodeLayerWeight": _outputs(
        _simple("layer_weight", "facing", ("blend", "Blend", 0.5), ("normal", "Normal", None)),
        {"Fresnel": "fresnel", "Facing": "facing"},
    ),
    "ShaderNodeObjectInfo": _object_info,
    "ShaderNodeLightPath": _light_path,
}
