"""Nodes that Blender's shaders share with its other trees: numbers that are whole or true and false, and switches."""

from __future__ import annotations

from typing import Any

import bpy

from .graph import Context, Source, switch_choices
from .strings import STRING_VALUES
from .translation import TranslateClosure, TranslateValue, Translation

Link = dict[str, Any]


def _math(t: Translation, operation: str, a: Any, b: Any = 0.0) -> Link:
    node = {"type": "math", "operation": operation, "clamp": False, "a": a, "b": b, "c": 0.0}
    return {"node": t.emit(node), "output": "value"}


def _truth(t: Translation, node: bpy.types.Node, socket: int, context: Context) -> Any:
    """An input that is true or false, as 1 or 0."""
    value = t.number(node, socket, context)
    return _math(t, "GREATER_THAN", value) if isinstance(value, dict) else float(value > 0.0)


def _integer_math(t: Translation, source: Source) -> Any:
    node = source.node

    def description() -> dict[str, Any]:
        a, b, c = (t.number(node, index, source.context) for index in range(3))
        return {"type": "integer_math", "operation": node.operation, "a": a, "b": b, "c": c}

    return {"node": t.once(source, description), "output": "value"}


def _boolean_math(t: Translation, source: Source) -> Any:
    node = source.node

    def value() -> Any:
        a, b = (_truth(t, node, index, source.context) for index in range(2))
        match node.operation:
            case "AND" | "NAND":
                found = _math(t, "MULTIPLY", a, b)
            case "OR" | "NOR":
                found = _math(t, "MAXIMUM", a, b)
            case "XOR" | "XNOR":
                found = _math(t, "ABSOLUTE", _math(t, "SUBTRACT", a, b))
            case "IMPLY" | "NIMPLY":
                found = _math(t, "MAXIMUM", _math(t, "SUBTRACT", 1.0, a), b)
            case _:
                found = a
        is_negated = node.operation in {"NOT", "NAND", "NOR", "XNOR", "NIMPLY"}
        return _math(t, "SUBTRACT", 1.0, found) if is_negated else found

    return t.value_once(source, value)


def _vector_component(t: Translation, source: Source) -> Any:
    """A component by its number, 0 beyond the third."""

    def value() -> Any:
        index = t.number(source.node, "Index", source.context)
        separate = t.emit({"type": "separate_xyz", "vector": t.value(source.node, "Vector", source.context)})
        parts = [{"node": separate, "output": axis} for axis in "xyz"]
        return _picked(t, index, parts, "float")

    return t.value_once(source, value)


def _switch(t: Translation, source: Source) -> Any:
    """A switch whose condition varies or is computed."""
    node, context = source.node, source.context

    def value() -> Any:
        data = {"RGBA": "color", "VECTOR": "vector"}.get(source.socket.type, "float")
        nothing = 0.0 if data == "float" else [0.0] * 3
        choices = [nothing if choice is None else t.socket_value(choice, context) for choice in switch_choices(node)]
        if node.bl_idname == "GeometryNodeIndexSwitch":
            return _picked(t, t.number(node, 0, context), choices, data)
        without, chosen = choices
        return _mixed(t, _truth(t, node, 0, context), without, chosen, data)

    return t.value_once(source, value)


def _picked(t: Translation, index: Any, choices: list[Any], data: str) -> Any:
    """The choice of a whole number; 0 where there is none."""
    whole = _math(t, "TRUNC", index)
    picked: Any = 0.0 if data == "float" else [0.0] * 3
    for number, choice in enumerate(choices):
        picked = _mixed(t, _math(t, "COMPARE", whole, float(number)), picked, choice, data)
    return picked


def _mixed(t: Translation, factor: Any, a: Any, b: Any, data: str) -> Link:
    settings = {"data": data, "blend": "MIX", "clamp_factor": True, "clamp_result": False}
    mix = t.emit({"type": "mix", **settings, "factor": factor, "a": a, "b": b})
    return {"node": mix, "output": data.replace("float", "value")}


def _switched_shader(t: Translation, node: bpy.types.Node, context: Context) -> int | None:
    """A switch between shaders whose condition varies."""
    shaders = [t.shader(choice, context) if choice is not None else None for choice in switch_choices(node)]
    if node.bl_idname != "GeometryNodeIndexSwitch":
        return _mixed_shader(t, _truth(t, node, 0, context), *shaders)
    whole = _math(t, "TRUNC", t.number(node, 0, context))
    picked: int | None = None
    for number, shader in enumerate(shaders):
        picked = _mixed_shader(t, _math(t, "COMPARE", whole, float(number)), picked, shader)
    return picked


def _mixed_shader(t: Translation, factor: Any, a: int | None, b: int | None) -> int:
    return t.emit({"type": "mix_shader", "factor": factor, "a": a, "b": b})


SWITCHES: dict[str, TranslateClosure] = {
    "GeometryNodeSwitch": _switched_shader,
    "GeometryNodeIndexSwitch": _switched_shader,
    "NodeEnableOutput": _switched_shader,
}
"""Switches between shaders."""
FUNCTION_VALUES: dict[str, TranslateValue] = {
    **STRING_VALUES,
    "FunctionNodeIntegerMath": _integer_math,
    "FunctionNodeBooleanMath": _boolean_math,
    "FunctionNodeGetVectorComponent": _vector_component,
    "GeometryNodeSwitch": _switch,
    "GeometryNodeIndexSwitch": _switch,
    "NodeEnableOutput": _switch,
}
