"""Attributes of meshes, objects, instancers, view layers and media, as nodes read them."""

from __future__ import annotations

from typing import Any

from ..object_attributes import OF_INSTANCER, object_name
from .graph import Source
from .surface_nodes import OF_SHAPE
from .translation import TranslateValue, Translation

FACTOR = "\tfactor"
"""Behind the name of an attribute that is asked for as one number."""


def _uv_map(t: Translation, source: Source) -> Any:
    """A UV map by its name may be an attribute of any kind."""
    if source.node.from_instancer:
        return t.of_object(source, OF_INSTANCER["uv"], "vector")
    name = attribute_name(source.node)
    node = {"type": "attribute", "name": name} if name else {"type": "uv_map", "name": ""}
    return {"node": t.once(source, lambda: node), "output": "vector"}


def _attribute(t: Translation, source: Source) -> Any:
    """Color Attribute, and Attribute where it names one."""
    node, output = source.node, source.socket.identifier
    if (kind := getattr(node, "attribute_type", "GEOMETRY")) != "GEOMETRY":
        return _attribute_of_object(t, source, kind, output)
    name = attribute_name(node) or ""
    if t.in_medium:
        return _grid(t, source, name, output)
    if name == "" and node.bl_idname == "ShaderNodeAttribute":
        return 1.0 if output == "Alpha" else [0.0, 0.0, 0.0]
    if name:
        t.attributes[name] = node.name
    if node.bl_idname == "ShaderNodeVertexColor":
        return {"node": t.once(source, lambda: {"type": "color_attribute", "name": name}), "output": output.lower()}
    if output == "Fac":
        number = t.once(source, lambda: {"type": "attribute", "name": name + FACTOR}, "factor")
        return {"node": number, "output": "value"}
    return {"node": t.once(source, lambda: {"type": "attribute", "name": name}), "output": output.lower()}


def _attribute_of_object(t: Translation, source: Source, kind: str, output: str) -> Any:
    """An attribute of an object, its instancer or the view layer."""
    name = source.node.attribute_name
    if not name:
        return 1.0 if output == "Alpha" else [0.0] * 3
    if kind == "VIEW_LAYER":
        *color, alpha = t.surroundings.value_of_layer(name)
        return alpha if output == "Alpha" else sum(color) / 3.0 if output == "Fac" else color
    link = t.of_object(source, object_name(kind, name), output.lower())
    if output != "Fac" or not isinstance(link, dict):
        return link
    return _mean(t, source, {**link, "output": "vector"}, "mean")


def _grid(t: Translation, source: Source, name: str, output: str) -> Any:
    """An attribute within a medium: a grid, 0 where an object has none of that name. Of a colour, its one number is the
    mean."""
    link = {"node": t.once(source, lambda: {"type": "attribute", "name": name}), "output": "vector"}
    return _mean(t, source, link, "factor") if output == "Fac" else {**link, "output": output.lower()}


def _mean(t: Translation, source: Source, link: dict[str, Any], part: str) -> dict[str, Any]:
    """The mean of a vector, which is what becomes of it where it is a number."""
    settings = {"operation": "ADD", "clamp": False, "b": 0.0, "c": 0.0}
    return {"node": t.once(source, lambda: {"type": "math", "a": link, **settings}, part), "output": "value"}


def _volume_info(t: Translation, source: Source) -> Any:
    """Grids by their usual names, which surfaces do not have."""
    output = source.socket.identifier
    if not t.in_medium:
        return [0.0] * 3 if output == "Color" else 0.0
    name = output.lower()
    node = t.once(source, lambda: {"type": "attribute", "name": name}, name)
    if output == "Color":
        return {"node": node, "output": "color"}
    return _mean(t, source, {"node": node, "output": "vector"}, f"{name} mean")


def asked_of(node: Any) -> list[str]:
    """Names under which a node asks meshes for attributes."""
    if node.bl_idname == "ShaderNodeNewGeometry":
        return [
            OF_SHAPE[socket.identifier] for socket in node.outputs if socket.identifier in OF_SHAPE and socket.is_linked
        ]
    name = attribute_name(node)
    if not name or getattr(node, "attribute_type", "GEOMETRY") != "GEOMETRY":
        return []
    outputs = {socket.identifier for socket in node.outputs if socket.is_linked}
    return [name] * bool(outputs - {"Fac"}) + [name + FACTOR] * ("Fac" in outputs)


def attribute_name(node: Any) -> str | None:
    """Name of the attribute that a node reads from meshes; None for other nodes. An empty name is the rendered colour
    for Color Attribute, and the rendered UV map for UV Map."""
    names = {
        "ShaderNodeVertexColor": "layer_name",
        "ShaderNodeAttribute": "attribute_name",
        "ShaderNodeUVMap": "uv_map",
    }
    return getattr(node, names[node.bl_idname]) if node.bl_idname in names else None


ATTRIBUTE_VALUES: dict[str, TranslateValue] = {
    "ShaderNodeUVMap": _uv_map,
    "ShaderNodeVertexColor": _attribute,
    "ShaderNodeAttribute": _attribute,
    "ShaderNodeVolumeInfo": _volume_info,
}
