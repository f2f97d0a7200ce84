"""One material: finds its surface and hands its nodes to the tables of closures and values."""

from __future__ import annotations

import json
from typing import Any

import bpy

from ..images import ImageExporter
from .closures import CLOSURES, FALLBACK_CLOSURES
from .graph import Context, Source, Unlinked, convert, node_constant, resolve, socket_default, trace, used_tree
from .values import VALUES, attribute_name

Key = tuple[int | str, ...]
"""A node in its groups, and which part of it."""

DEFAULT_SURFACE = {"type": "diffuse", "color": [0.8, 0.8, 0.8], "roughness": 0.0, "normal": None}
EMISSION = {"emission": ("strength", 0.0), "principled": ("emission_strength", 0.0)}
TRANSPARENCY = {"transparent": ("color", [0.0, 0.0, 0.0]), "principled": ("alpha", 1.0)}
"""Fields of closures by their type, and the values that do nothing."""


class MaterialExporter:
    """Exports each material once and remembers its number."""

    def __init__(self, builder: Any, images: ImageExporter):
        self.builder = builder
        self.images = images
        self.numbers: dict[str | None, int] = {}
        self.emissive: set[int] = set()
        """Numbers of those that may emit light."""
        self.attributes: dict[int, dict[str, str]] = {}
        """Of a material's number: names that it asks meshes for, with the material and node for messages."""

    def number(self, material: bpy.types.Material | None, object_name: str) -> int:
        """Number of a material; None is Cycles' grey default. `object_name` is for messages."""
        key = material.name_full if material else None
        if key not in self.numbers:
            self.numbers[key] = self._export(material, object_name)
        return self.numbers[key]

    def _export(self, material: bpy.types.Material | None, object_name: str) -> int:
        translation = Translation(self.builder, self.images, material, object_name)
        description = translation.run()
        if not _is_finite(description):
            translation.name("one of its values is not a finite number; taken as grey diffuse")
            description |= {"nodes": [DEFAULT_SURFACE], "surface": 0}
        if material is not None and not material.use_transparent_shadow and _any(description, TRANSPARENCY):
            translation.name("shadows that ignore transparency are not supported; light passes what is transparent")
        number = self.builder.add_material(json.dumps(description))
        self.attributes[number] = {
            name: f"material '{description['name']}', node '{node}'" for name, node in translation.attributes.items()
        }
        if _any(description, EMISSION):
            self.emissive.add(number)
        return number


def asked_attributes() -> set[str]:
    """Names that the materials of the open file ask meshes for."""
    trees = [block.node_tree for block in bpy.data.materials if block.node_tree] + list(bpy.data.node_groups)
    return {name for tree in trees for node in tree.nodes if (name := attribute_name(node))}


class Translation:
    """The graph of one material under construction. Node tables receive it to translate their inputs."""

    def __init__(self, builder: Any, images: ImageExporter, material: bpy.types.Material | None, object_name: str):
        self.builder = builder
        self.images = images
        self.material = material
        self.owner = f"object '{object_name}', material '{material.name}'" if material else f"object '{object_name}'"
        self.nodes: list[dict[str, Any]] = []
        self.done: dict[Key, Any] = {}
        self.attributes: dict[str, str] = {}
        """Names of what it asks meshes for, and of a node that does."""

    def run(self) -> dict[str, Any]:
        """The JSON form of the material."""
        surface = self._surface()
        name = self.material.name if self.material else "Default"
        return {"name": name, "nodes": self.nodes, "surface": surface}

    def _surface(self) -> int | None:
        material = self.material
        if material is None:
            return self.emit(DEFAULT_SURFACE)
        tree = used_tree(material)
        if tree is None:
            return self.emit(DEFAULT_SURFACE | {"color": list(material.diffuse_color)[:3]})
        output = tree.get_output_node("CYCLES")
        if output is None:
            return None
        unsupported = [kind for kind in ("Volume", "Displacement") if resolve(output.inputs[kind], ()) is not None]
        for kind in unsupported:
            self.name(f"{kind.lower()} is not supported yet; left out")
        if "Volume" in unsupported and resolve(output.inputs["Surface"], ()) is None:
            return self.emit({"type": "transparent", "color": [1.0, 1.0, 1.0]})  # Cycles passes through it as well.
        return self.shader(output.inputs["Surface"], ())

    def emit(self, node: dict[str, Any]) -> int:
        """Appends a node and returns its number."""
        self.nodes.append(node)
        return len(self.nodes) - 1

    def name(self, what: str) -> None:
        """Tells the user what of this material could not be represented."""
        self.builder.warn(f"{self.owner}: {what}")

    def shader(self, socket: bpy.types.NodeSocket, context: Context) -> int | None:
        """Number of the closure node that feeds a shader socket."""
        source = resolve(socket, context)
        if source is None:
            return None
        key = _key(source)
        if key not in self.done:
            self.done[key] = self._closure(source)
        return self.done[key]

    def _closure(self, source: Source) -> int | None:
        kind = source.node.bl_idname
        if kind in CLOSURES:
            return CLOSURES[kind](self, source.node, source.context)
        if kind in FALLBACK_CLOSURES:
            self.name(f"node '{source.node.name}' is not supported yet; taken as {FALLBACK_CLOSURES[kind][0]}")
            return FALLBACK_CLOSURES[kind][1](self, source.node, source.context)
        self.name(f"node '{source.node.name}' ({source.node.bl_label}) is not supported yet; taken as grey diffuse")
        return self.emit(DEFAULT_SURFACE)

    def value(self, node: bpy.types.Node, socket: str | int, context: Context, default: Any = 0.0) -> Any:
        """An input as JSON: a number, three numbers or a link. `default` stands for a socket that this Blender
        does not have, or that shows no value."""
        try:
            target = node.inputs[socket]
        except (KeyError, IndexError):
            return default
        return self.socket_value(target, context, default)

    def socket_value(self, target: bpy.types.NodeSocket, context: Context, default: Any = 0.0) -> Any:
        """See `value`."""
        source = trace(target, context)
        if source is None:
            return convert([0.0, 0.0, 0.0], target, is_color=True)
        if isinstance(source, Unlinked):
            value = socket_default(source.socket)
            return default if value is None else convert(value, target, source.socket.type == "RGBA")
        if source.node.bl_idname == "ShaderNodeObjectInfo" and source.socket.identifier == "Material Index":
            index = self.material.pass_index if self.material else 0
            return convert(float(index), target, is_color=False)
        constant = node_constant(source)
        if constant is None:
            constant = self._output(source)
        if isinstance(constant, dict):
            return constant
        return convert(constant, target, source.socket.type == "RGBA")

    def _output(self, source: Source) -> Any:
        """A link to the translated node, or a constant in place of a node that is not known."""
        translate = VALUES.get(source.node.bl_idname)
        if translate is None:
            neutral = 0.5 if source.socket.type in {"VALUE", "RGBA"} else [0.0, 0.0, 0.0]
            self.name(
                f"node '{source.node.name}' ({source.node.bl_label}) is not supported yet; taken as constant {neutral}"
            )
            return neutral
        return translate(self, source)

    def once(self, source: Source, description: Any, part: str = "") -> int:
        """Number of a node that several outputs share; `description` makes it the first time. `part` tells several
        nodes apart that one node of Blender becomes."""
        key: Key = (*_key(source), part)
        if key not in self.done:
            self.done[key] = self.emit(description())
        return self.done[key]


def _is_finite(description: dict[str, Any]) -> bool:
    try:
        json.dumps(description, allow_nan=False)
    except ValueError:
        return False
    return True


def _any(description: dict[str, Any], fields: dict[str, tuple[str, Any]]) -> bool:
    """Whether a closure of a material has one of the fields at another value than that which does nothing."""
    closures = (node for node in description["nodes"] if node["type"] in fields)
    return any(node[field] != nothing for node in closures for field, nothing in (fields[node["type"]],))


def _key(source: Source) -> Key:
    return (source.node.as_pointer(), *(group.as_pointer() for group in source.context))
