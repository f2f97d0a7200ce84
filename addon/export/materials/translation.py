"""Translation of the graph of one material, which hands nodes to the tables of closures and values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import bpy

from ..images import ImageExporter
from ..object_attributes import Surroundings
from .graph import (
    CONVERTING,
    IS_INLINED,
    NUMBERS,
    UNFOLDED,
    Constant,
    Context,
    Source,
    constant_of,
    is_implied,
    node_constant,
    passed_on,
    resolve,
    surface_socket,
    trace,
    used_tree,
)

Key = tuple[int | str, ...]
"""A node in its groups, and which part of it."""
TranslateClosure = Callable[["Translation", bpy.types.Node, Context], "int | None"]
"""Translates a closure node; returns its number."""
TranslateValue = Callable[["Translation", Source], Any]
"""Translates a node that gives values; returns a link or a constant."""

DEFAULT_SURFACE = {"type": "diffuse", "color": [0.8, 0.8, 0.8], "roughness": 0.0, "normal": None}
NOTHING = {"type": "add_shader", "a": None, "b": None}
"""A closure without effect."""
VARYING = {"image_texture", "procedural", "texture_coordinate", "geometry"}
"""Types of nodes whose values differ from place to place within a medium."""
BUMP_WIDTH = 0.1 if bpy.app.version >= (4, 3, 0) else 1.0
"""Pixels over which Cycles takes differences of a displacement."""
SURFACE_BEFORE = "undisplaced" if bpy.app.version >= (5, 0, 0) else "undisplaced_places"
"""Surface on which Cycles bumps what is displaced as well, and maps normals if not told."""
COMPUTED = {
    *("mix", "math", "vector_math", "map_range", "clamp", "color_ramp", "rgb_curves", "gamma"),
    *("separate_xyz", "combine_xyz", "integer_math"),
}
"""Types of nodes that Blender computes where it inlines and their inputs are constants."""


def sampling_settings(material: bpy.types.Material | None) -> dict[str, bool]:
    """Settings of how Cycles samples lights through a material, and its emission, where they are not the default."""
    cycles = getattr(material, "cycles", None)
    found = {
        "opaque_shadows": material is not None and not material.use_transparent_shadow,
        "unsampled_emission": getattr(cycles, "emission_sampling", "AUTO") == "NONE",
    }
    return {name: True for name, is_set in found.items() if is_set}


def bump_shadowing(material: bpy.types.Material | None) -> str:
    """Cycles' dimming of a material's diffuse reflection about bent normals, in the JSON form."""
    corrects = getattr(getattr(material, "cycles", None), "use_bump_map_correction", True)
    return "off" if not corrects else "facets" if bpy.app.version >= (4, 5, 0) else "cosines"


class NodeTables(NamedTuple):
    """Functions that translate nodes, by their `bl_idname`."""

    closures: dict[str, TranslateClosure]
    volumes: dict[str, TranslateClosure]
    """Closures of media."""
    values: dict[str, TranslateValue]


class UnfoldedColor(list[float]):
    """Colour of a node that Blender hands on to Cycles as it is."""


class UnfoldedNumber(float):
    """Number of such a node."""


class Translation:
    """The graph of one material under construction. Node tables receive it to translate their inputs."""

    def __init__(
        self,
        builder: Any,
        images: ImageExporter,
        tables: NodeTables,
        material: bpy.types.Material | None,
        object_name: str,
        surroundings: Surroundings,
    ):
        """Translates one material; messages name the object that shows it."""
        self.builder = builder
        self.tables = tables
        self.images = images
        self.surroundings = surroundings
        self.material = material
        self.title = material.name if material else "Default"
        self.owner = f"object '{object_name}', material '{material.name}'" if material else f"object '{object_name}'"
        self.glow = 1.0
        """Strength of the emission that a colour or number becomes in place of a shader."""
        self.nodes: list[dict[str, Any]] = []
        self._constants: list[bool] = []
        """True for each node that Blender knows to be constant."""
        self.done: dict[Key, Any] = {}
        self.normal: dict[str, Any] | None = None
        """A link to the shading normal, where it is not the mesh's."""
        self.bumped: dict[str, Any] = {}
        """The normal that displacement bumps, as a field of the JSON form."""
        self.displacement: dict[str, Any] | None = None
        """Offset of vertices in the JSON form, if it moves any."""
        self.attributes: dict[str, str] = {}
        """Names of the mesh attributes that it reads, each with a node that does."""
        self.of_objects: set[str] = set()
        """Names that it asks each instance for, as of `object_attributes`."""
        self.medium_varies = False
        """True if the volume has nodes whose values differ from place to place."""
        self.in_medium = False
        """True while the volume is translated, where meshes have no attributes."""

    def run(self) -> dict[str, Any]:
        """The JSON form of the material."""
        surface = self._surface()
        tree = used_tree(self.material) if self.material is not None else None
        volume = self.volume(tree)
        if volume and surface is None and self._has_surface(tree):
            surface = self.emit(NOTHING)  # Black, where rays would pass without any.
        moved = {"displacement": self.displacement} if self.displacement else {}
        own = moved | self.bumped | sampling_settings(self.material) | {"bump_shadowing": bump_shadowing(self.material)}
        index = {"pass_index": self.material.pass_index} if self.material is not None else {}
        return {"name": self.title, "nodes": self.nodes, "surface": surface, **volume, **own, **index}

    def _has_surface(self, tree: bpy.types.NodeTree | None) -> bool:
        output = surface_socket(tree) if tree is not None else None
        return output is not None and resolve(*output) is not None

    def volume(self, tree: bpy.types.NodeTree | None) -> dict[str, Any]:
        """The medium of a tree as a field of the JSON form; none if nothing feeds its Volume socket."""
        output = surface_socket(tree) if tree is not None else None
        if output is None or not self._feeds("Volume", *output):
            return {}
        surface, context = output
        self.in_medium, self.normal = True, None
        self.done.clear()
        first = len(self.nodes)
        volume = self.shader(surface.node.inputs["Volume"], context)
        self.medium_varies = any(node["type"] in VARYING for node in self.nodes[first:])
        # Where nothing of it counts, there is still a hull that rays pass.
        return {"volume": self.emit(NOTHING) if volume is None else volume}

    def _surface(self) -> int | None:
        material = self.material
        if material is None:
            return self.emit(DEFAULT_SURFACE)
        tree = used_tree(material)
        if tree is None:
            return self.emit(DEFAULT_SURFACE | {"color": list(material.diffuse_color)[:3]})
        output = surface_socket(tree)
        if output is None:
            return None
        surface, context = output
        if self._feeds("Displacement", surface, context):
            self._displace(material.displacement_method, surface.node.inputs["Displacement"], context)
        return self.shader(surface, context)

    def _feeds(self, name: str, surface: bpy.types.NodeSocket, context: Context) -> bool:
        """True if a node feeds another input of the output node."""
        inputs = surface.node.inputs
        return name in inputs and resolve(inputs[name], context) is not None

    def _displace(self, method: str, socket: bpy.types.NodeSocket, context: Context) -> None:
        """Takes the displacement as a bump of the normal, an offset of vertices, or both."""
        offset = self.socket_value(socket, context, None)
        # Nodes of the surface have the bumped normal.
        self.done.clear()
        if not isinstance(offset, dict):
            return
        if method != "BUMP":
            self.displacement = {"offset": offset, "keeps_normals": method == "BOTH"}
        if method != "DISPLACEMENT":
            self.normal = self._bumped(offset, "shaded" if method == "BUMP" else SURFACE_BEFORE)
            self.bumped = {"bumped_normal": self.normal}

    def _bumped(self, displacement: dict[str, Any], base: str) -> dict[str, Any]:
        """The shading normal of a surface whose displacement Cycles bumps."""
        geometry = self.emit({"type": "geometry"})
        normal = {"node": geometry, "output": "normal"}
        inputs = {"a": displacement, "b": normal, "c": [0.0] * 3, "scale": 1.0}
        height = self.emit({"type": "vector_math", "operation": "DOT_PRODUCT", **inputs})
        settings = {"invert": False, "strength": 1.0, "distance": 1.0, "filter_width": BUMP_WIDTH, "normal": None}
        bump = {"type": "bump", "base": base, **settings, "height": {"node": height, "output": "value"}}
        return {"node": self.emit(bump), "output": "normal"}

    def emit(self, node: dict[str, Any]) -> int:
        """Appends a node and returns its number."""
        self.nodes.append(node)
        self._constants.append(node["type"] in COMPUTED and all(map(self.is_constant, node.values())))
        return len(self.nodes) - 1

    def is_constant(self, value: Any) -> bool:
        """True if Blender knows that an input is the same everywhere."""
        if isinstance(value, UnfoldedColor | UnfoldedNumber):
            return not IS_INLINED
        return not isinstance(value, dict) or "node" not in value or self._constants[value["node"]]

    def warn(self, message: str) -> None:
        """Warns the user of a part of this material that cannot be represented."""
        self.builder.warn(f"{self.owner}: {message}")

    def shader(self, socket: bpy.types.NodeSocket, context: Context) -> int | None:
        """Number of the closure node that feeds a shader socket; a colour or number there is emitted."""
        source = trace(socket, context)
        if isinstance(source, Constant):
            color = constant_of(source, socket)
        elif source.socket.type != "SHADER":
            color = self._link_value(source, "RGBA")
        else:
            key = _key(source)
            if key not in self.done:
                self.done[key] = self._closure(source)
            return self.done[key]
        return None if color is None else self.emit({"type": "emission", "color": color, "strength": self.glow})

    def _closure(self, source: Source) -> int | None:
        kind = source.node.bl_idname
        if self.in_medium:
            translate = self.tables.volumes.get(kind)
            return translate(self, source.node, source.context) if translate is not None else None
        if kind in self.tables.closures:
            return self.tables.closures[kind](self, source.node, source.context)
        self.warn(f"node '{source.node.name}' ({source.node.bl_label}) is not supported yet; taken as grey diffuse")
        return self.emit(DEFAULT_SURFACE)

    def value(self, node: bpy.types.Node, socket: str | int, context: Context, default: Any = 0.0) -> Any:
        """An input as JSON: a number, three numbers or a link. `default` stands for a socket that this Blender
        does not have; None as default for one that implies its value where nothing is linked."""
        try:
            target = node.inputs[socket]
        except (KeyError, IndexError):
            return default
        return self.socket_value(target, context, default)

    def socket_value(self, target: bpy.types.NodeSocket, context: Context, default: Any = 0.0) -> Any:
        """See `value`."""
        source = trace(target, context)
        if default is None and is_implied(source, target):
            return self.normal if target.identifier in {"Normal", "Coat Normal"} else None
        if isinstance(source, Source):
            return self._link_value(source, target.type)
        value = constant_of(source, target)
        return default if value is None else value

    def number(self, node: bpy.types.Node, socket: str | int, context: Context, default: float = 0.0) -> Any:
        """An input as JSON that is a number also where a colour is linked to it."""
        value = self.value(node, socket, context, default)
        if isinstance(value, dict) and value["output"] in {"color", "vector", "normal"}:
            return self._math("ADD", value)
        return value

    def _link_value(self, source: Source, target: str) -> Any:
        """Value of a node, as a socket of a type sees it."""
        kind = source.socket.type
        value = self._constant(source)
        if value is None:
            value = self._output(source)
        if value is None:
            return None
        if not isinstance(value, dict):
            value = passed_on(value, kind, (*source.passed, target))
            if source.node.bl_idname not in UNFOLDED:
                return value
            return UnfoldedColor(value) if isinstance(value, list) else UnfoldedNumber(value)
        for index, to in enumerate(source.passed):
            if self.is_constant(value) or to in CONVERTING:
                is_narrowed = not NUMBERS.isdisjoint({*source.passed[index + 1 :], target})
                value, kind = self._converted(value, kind, to, is_narrowed), to
        return value

    def _constant(self, source: Source) -> Any:
        if source.node.bl_idname == "ShaderNodeObjectInfo" and source.socket.identifier == "Material Index":
            return float(self.material.pass_index if self.material else 0)
        return node_constant(source)

    def _converted(self, link: dict[str, Any], kind: str, to: str, is_narrowed: bool) -> dict[str, Any]:
        """A link's value after it has passed a socket of another type. `is_narrowed`: it becomes a number later, which
        differs for colours and vectors."""
        if to == "BOOLEAN" and IS_INLINED:
            return self._math("GREATER_THAN", self._length(link) if kind == "VECTOR" else link)
        if to in {"INT", "BOOLEAN"} and kind not in {"INT", "BOOLEAN"}:
            return self._math("TRUNC", link)
        if to == "VALUE" and kind in {"RGBA", "VECTOR"}:
            return self._math("ADD", link)
        if {kind, to} == {"RGBA", "VECTOR"} and is_narrowed:
            return self.as_color(link) if to == "RGBA" else self._as_vector(link)
        return link

    def _math(self, operation: str, link: dict[str, Any]) -> dict[str, Any]:
        settings = {"operation": operation, "clamp": False, "b": 0.0, "c": 0.0}
        return {"node": self.emit({"type": "math", "a": link, **settings}), "output": "value"}

    def as_color(self, link: dict[str, Any]) -> dict[str, Any]:
        """A link whose value becomes a number by its luminance."""
        settings = {"data": "color", "blend": "MIX", "clamp_factor": True, "clamp_result": False}
        mix = {"type": "mix", **settings, "factor": 0.0, "a": link, "b": [0.0] * 3}
        return {"node": self.emit(mix), "output": "color"}

    def _length(self, link: dict[str, Any]) -> dict[str, Any]:
        settings = {"operation": "LENGTH", "b": [0.0] * 3, "c": [0.0] * 3, "scale": 1.0}
        return {"node": self.emit({"type": "vector_math", "a": link, **settings}), "output": "value"}

    def _as_vector(self, link: dict[str, Any]) -> dict[str, Any]:
        settings = {"operation": "ADD", "b": [0.0] * 3, "c": [0.0] * 3, "scale": 1.0}
        return {"node": self.emit({"type": "vector_math", "a": link, **settings}), "output": "vector"}

    def _output(self, source: Source) -> Any:
        """A link to the translated node, or a constant in place of a node that is not known."""
        translate = self.tables.values.get(source.node.bl_idname)
        if translate is None:
            neutral = 0.5 if source.socket.type in {"VALUE", "RGBA"} else [0.0, 0.0, 0.0]
            self.warn(
                f"node '{source.node.name}' ({source.node.bl_label}) is not supported yet; taken as constant {neutral}"
            )
            return neutral
        return translate(self, source)

    def of_object(self, source: Source, name: str, output: str) -> Any:
        """A value that each instance of an object has as a whole, by its name in `object_attributes`."""
        if self.in_medium:
            self.warn(f"node '{source.node.name}': values of objects are not known within volumes; taken as 0")
            return 0.0 if output == "alpha" else [0.0] * 3
        self.of_objects.add(name)
        return {"node": self.once(source, lambda: {"type": "attribute", "name": name}, name), "output": output}

    def value_once(self, source: Source, compute: Callable[[], Any], part: str = "") -> Any:
        """Value of a node, or of a part of it, computed the first time: its inputs lead to all that is before it."""
        key: Key = (*_key(source), f"value {part}")
        if key not in self.done:
            self.done[key] = compute()
        return self.done[key]

    def once(self, source: Source, description: Any, part: str = "") -> int:
        """Number of a node that several outputs share; `description` makes it the first time. `part` tells several
        nodes apart that one node of Blender becomes."""
        key: Key = (*_key(source), part)
        if key not in self.done:
            self.done[key] = self.emit(description())
        return self.done[key]


def _key(source: Source) -> Key:
    return (source.node.as_pointer(), *(group.as_pointer() for group in source.context))
