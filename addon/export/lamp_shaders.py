"""Emission of lamps by their node trees: one colour, or a table by direction or place, and falloffs."""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import bpy
import numpy as np
from mathutils import Matrix

from .images import ImageExporter, TextureSize, path_of
from .materials.constants import PURE_NODES, ConstantEmission, ConstantTranslation, VaryingNodeError
from .materials.graph import Context, Source, surface_socket, used_tree
from .materials.procedural import TEXTURES
from .materials.surface_nodes import ies
from .materials.translation import Translation

LIGHT_PATH = dict.fromkeys(
    (
        *("Is Camera Ray", "Is Shadow Ray", "Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray"),
        *("Is Reflection Ray", "Is Transmission Ray", "Is Volume Scatter Ray"),
    ),
    0.0,
)
"""Outputs of the Light Path node that are the same for all rays that meet a lamp."""
TABULATED = PURE_NODES | TEXTURES.keys() | {"ShaderNodeMapping", "ShaderNodeTexImage"}
"""Nodes whose value has a place in a table if their inputs have."""
COORDINATES = {"Normal": "normal", "UV": "uv"}
"""Outputs of Texture Coordinate that do not depend on where a lamp is met."""
DIRECTIONS = {"Normal": "normal", "True Normal": "normal", "Incoming": "incoming"}
"""Outputs of Geometry likewise, in world space."""
PLACES = {"Object", "Generated"} if bpy.app.version >= (4, 5, 0) else set()
"""Outputs of Texture Coordinate that are places in the space of a lamp: since lamps are objects in Cycles."""
POWERS = {"Quadratic": 0.0, "Linear": 1.0, "Constant": 2.0}
"""Powers of the distance by which outputs of Light Falloff grow."""
FINE, COARSE = 512, 256
"""Texels along the edges of a table: of textures, and of all else and what is made anew when a lamp turns."""
MOST_TABLES = 32
"""Tables that are kept."""


class Emission(NamedTuple):
    """Emission of a lamp."""

    color: list[float]
    """Where its table is white, or everywhere."""
    table: dict[str, Any] | None = None
    """JSON form of `relume_scene::EmissionMap`."""


class LampShaders:
    """Computes what lamps emit, with the native module."""

    def __init__(
        self,
        constant_emission: ConstantEmission,
        new_builder: Callable[[], Any],
        frame: int,
        size: TextureSize = None,
    ):
        """`new_builder` makes scene builders without anything; images of sequences are those of a frame."""
        self.constant_emission = constant_emission
        self.new_builder = new_builder
        self.frame = frame
        self.size = size

    def emission(self, obj: bpy.types.Object, world_from_object: Any, warn: Callable[[str], None]) -> Emission | None:
        """Emission of a light's nodes; None if they emit nothing. Raises VaryingNodeError."""
        tree = used_tree(obj.data)
        if tree is None:
            return Emission([1.0, 1.0, 1.0])
        surface = surface_socket(tree)
        if surface is None:
            return None
        is_sun = obj.data.type == "SUN"
        try:
            constant = ConstantTranslation(self.constant_emission, LIGHT_PATH.get, is_sun).emission(*surface)
        except VaryingNodeError:
            return self._varying(obj, surface, world_from_object, warn)
        return None if constant is None else Emission(constant)

    def _varying(
        self,
        obj: bpy.types.Object,
        surface: tuple[bpy.types.NodeSocket, Context],
        world_from_object: Any,
        warn: Callable[[str], None],
    ) -> Emission | None:
        images = _NamedImages(self.frame)
        shader = _TableTranslation(self.constant_emission, images, obj)
        root = shader.shader(*surface)
        if root is None:
            return None
        material = json.dumps({"name": obj.name, "nodes": shader.nodes, "surface": root})
        lamp = json.dumps(shader.lamp(world_from_object))
        key = material, lamp, images.stamps(), self.size
        if key not in _tables:
            while len(_tables) >= MOST_TABLES:
                del _tables[next(iter(_tables))]
            _tables[key] = self._table(images, material, lamp)
        found, messages = _tables[key] = _tables.pop(key)
        for message in messages:
            warn(f"light '{obj.name}': {message}")
        return found

    def _table(self, images: _NamedImages, material: str, lamp: str) -> tuple[Emission | None, list[str]]:
        builder = self.new_builder()
        shelf = _Shelf(builder)
        images.export(ImageExporter(shelf, self.frame, size=self.size))
        found, notes = builder.emission_map(builder.add_material(material), lamp)
        messages = [*shelf.messages, *notes]
        if found is None:
            return None, messages
        largest, table = found
        return Emission([largest] * 3, json.loads(table)), messages


_tables: dict[tuple[str, str, str, TextureSize], tuple[Emission | None, list[str]]] = {}
"""Tables by all that they are made of, with messages; the one used longest ago first."""


class _Shelf:
    """A scene builder that only takes images, and keeps what is said of them."""

    def __init__(self, builder: Any):
        self.add_texture, self.add_texture_file = builder.add_texture, builder.add_texture_file
        self.messages: list[str] = []
        self.warn = self.messages.append


class _NamedImages:
    """Images that a shader shows, without their pixels."""

    def __init__(self, frame: int):
        self.frame = frame
        self.shown: list[tuple[bpy.types.Image | None, str, bpy.types.ImageUser | None]] = []

    def number(self, image: bpy.types.Image, user: str, settings: bpy.types.ImageUser) -> int:
        """Number of an image among those that are shown; called like the image exporter's method."""
        self.shown.append((image, user, settings))
        return len(self.shown) - 1

    def missing(self, user: str) -> int:
        """Likewise of an image that is not there."""
        self.shown.append((None, user, None))
        return len(self.shown) - 1

    def stamps(self) -> str:
        """A text that differs where the images do."""
        return repr([_stamp(image, settings, self.frame) for image, _, settings in self.shown])

    def export(self, exporter: ImageExporter) -> None:
        """Exports the images in the order of their numbers."""
        for image, user, settings in self.shown:
            # Each shall have a number of its own.
            exporter.numbers.clear()
            if image is None or settings is None:
                exporter.missing(user)
            else:
                exporter.number(image, user, settings)


def _stamp(image: bpy.types.Image | None, settings: bpy.types.ImageUser | None, frame: int) -> list[Any]:
    if image is None or settings is None:
        return []
    path, pixels = path_of(image, settings, frame), 0
    if image.is_dirty:
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        pixels = zlib.crc32(values.tobytes())
    try:
        file = os.stat(path)
        changed = file.st_mtime_ns, file.st_size
    except (OSError, ValueError):
        changed = 0, 0
    packed = image.packed_file.size if image.packed_file else 0
    made = (image.generated_type, tuple(image.generated_color)) if image.source == "GENERATED" else ()
    shown = image.name_full, image.source, image.colorspace_settings.name, image.alpha_mode, tuple(image.size)
    return [shown, path, changed, packed, made, pixels]


class _TableTranslation(ConstantTranslation):
    """The graph of a lamp, in which what has no place in a table by direction or place stands for itself."""

    def __init__(self, compute: ConstantEmission, images: _NamedImages, obj: bpy.types.Object):
        super().__init__(compute, LIGHT_PATH.get)
        self.images: Any = images
        self.owner = f"light '{obj.name}'"
        self.light = obj.data
        self.reads: dict[str, bpy.types.Node] = {}
        """Directions and places that the graph reads, each with a node that does."""
        self.falloff: dict[str, float] | None = None
        """JSON form of `relume_scene::Falloff`."""
        self.emitters: list[bpy.types.Node] = []
        self.fading: list[bpy.types.Node] = []
        """Emission nodes, and those with the falloff."""
        self.in_world: bpy.types.Node | None = None
        """A node that reads directions of the world."""

    def lamp(self, world_from_object: Any) -> dict[str, Any]:
        """JSON form of `relume_trace::shading::Lamp`. Raises VaryingNodeError."""
        kinds = {node["type"] for node in self.nodes}
        lamp = {
            "kind": self._kind(world_from_object),
            "key": self._key(),
            "resolution": FINE if kinds & {"image_texture", "procedural"} and self.in_world is None else COARSE,
        }
        if self.falloff is not None:
            if len(self.fading) < len(self.emitters):
                raise VaryingNodeError(self.emitters[0])
            lamp["falloff"] = self.falloff
        if self.in_world is not None or not _is_turned_only(world_from_object):
            lamp["world_from_object"] = [list(row[:3]) for row in world_from_object[:3]]
        return lamp

    def _key(self) -> str:
        """Quantity that the table is looked up by. Raises VaryingNodeError if the graph reads another one, too."""
        light = self.light
        is_sphere = light.type in {"POINT", "SPOT"} and not light.use_soft_falloff and light.shadow_soft_size > 0.0
        match light.type:
            case "AREA":
                key, told = "place", {"uv", "object"}
            case "POINT" if is_sphere:
                key, told = "normal", {"normal", "uv"}
            case "SPOT" if is_sphere:
                key, told = "normal", {"normal"}
            case _:
                return "way_back"
        if told.isdisjoint(self.reads):
            return "way_back"
        # The normal of an area is the same everywhere.
        for other in self.reads.keys() - told - {"normal"}:
            raise VaryingNodeError(self.reads[other])
        return key

    def _kind(self, world_from_object: Any) -> dict[str, Any]:
        """JSON form of `relume_trace::shading::LampKind`."""
        light = self.light
        match light.type:
            case "SPOT":
                return {"type": "SPOT", "spot_size": light.spot_size}
            case "SUN":
                return {"type": "SUN", "angle": light.angle, "scale": list(Matrix(world_from_object).to_scale())[:2]}
            case "AREA":
                is_even = light.shape in {"SQUARE", "DISK"}
                size = [light.size, light.size if is_even else light.size_y]
                # Resizing makes no other table where places in metres do not matter.
                return {"type": "AREA", "size": size if "object" in self.reads else [1.0, 1.0]}
        return {"type": "POINT"}

    def emit(self, node: dict[str, Any]) -> int:
        """Appends a node and returns its number; notes what it reads by itself."""
        if node["type"] in {"image_texture", "ies"} and node["vector"] is None:
            self._read("uv" if node["type"] == "image_texture" else "incoming")
        if node["type"] == "uv_map":
            self._read("uv")
        is_placed = node["type"] == "procedural" and node["vector"] is None and node.get("dimensions") != "1D"
        if is_placed:
            node = {**node, "vector": self._place()}
        elif node["type"] == "texture_coordinate" and node["kind"] not in {"normal", "uv"}:
            raise VaryingNodeError(self._present[-1])
        return super().emit(node)

    def _place(self) -> dict[str, Any]:
        """Place on an area light in its space. Raises VaryingNodeError."""
        if self.light.type != "AREA" or not PLACES:
            raise VaryingNodeError(self._present[-1])
        self._read("object")
        return {"node": super().emit({"type": "texture_coordinate", "kind": "object"}), "output": "vector"}

    def _read(self, quantity: str) -> None:
        self.reads.setdefault(quantity, self._present[-1])

    def _computed(self, surface: int) -> list[float]:
        color, _ = self.compute(json.dumps({"name": "", "nodes": self.nodes, "surface": surface}))
        if color is None:
            raise VaryingNodeError(self._present[-1])
        return color

    def _closure(self, source: Source) -> int | None:
        if source.node.bl_idname == "ShaderNodeBsdfPrincipled":
            raise VaryingNodeError(source.node)
        if source.node.bl_idname == "ShaderNodeEmission":
            self.emitters.append(source.node)
        return super()._closure(source)

    def _output(self, source: Source) -> Any:
        self._present.append(source.node)
        value = self._tabulated(source)
        self._present.pop()
        return value

    def _tabulated(self, source: Source) -> Any:
        node, output = source.node, source.socket.identifier
        match node.bl_idname:
            case "ShaderNodeTexCoord" if output in COORDINATES and not (output == "UV" and node.from_instancer):
                self._read(COORDINATES[output])
                return Translation._output(self, source)
            case "ShaderNodeTexCoord" if output in PLACES and node.object is None:
                return self._place()
            case "ShaderNodeNewGeometry" if output in DIRECTIONS:
                self._read(DIRECTIONS[output])
                self.in_world = node
                return Translation._output(self, source)
            case "ShaderNodeTexImage" if node.projection == "BOX" or (node.image and node.image.source == "TILED"):
                raise VaryingNodeError(node)
            case "ShaderNodeLightFalloff" if not self._is_plain(source):
                return self._faded(source)
            case "ShaderNodeTexIES":
                return ies(self, source)
            case name if name in TABULATED:
                return Translation._output(self, source)
        return super()._output(source)

    def _faded(self, source: Source) -> Any:
        """Strength of a Light Falloff node. Raises VaryingNodeError unless the node scales all of an emission."""
        node, emission = source.node, self._present[-2]
        smooth = self.value(node, "Smooth", source.context)
        is_factor = emission.bl_idname == "ShaderNodeEmission" and emission not in self.fading
        if not is_factor or not isinstance(smooth, float) or self.light.type == "SUN":
            raise VaryingNodeError(node)
        falloff = {"power": POWERS[source.socket.identifier], "smooth": max(smooth, 0.0)}
        if self.falloff not in (None, falloff):
            raise VaryingNodeError(node)
        self.falloff = falloff
        self.fading.append(emission)
        return self.value(node, "Strength", source.context)

    def _varies(self, node: bpy.types.Node) -> dict[str, Any]:
        raise VaryingNodeError(node)


def _is_turned_only(matrix: Any) -> bool:
    """True if a transform keeps the angles between directions."""
    columns = [column.to_3d() for column in Matrix(matrix).to_3x3().col]
    lengths = [column.length for column in columns]
    normal = [column.normalized() for column in columns]
    skew = max(abs(normal[a].dot(normal[b])) for a, b in ((0, 1), (1, 2), (2, 0)))
    return max(lengths) - min(lengths) <= 1e-4 * max(lengths) and skew <= 1e-4
