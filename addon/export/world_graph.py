"""Nodes of a world as plain data, from which another Blender builds the same world.

It is a flat list, without groups, reroutes and muted nodes, with the values of the evaluated file. Light paths are
those of one kind of ray, after one bounce or from the camera."""

from __future__ import annotations

from typing import Any, NamedTuple

import bpy

from .materials.constants import ConstantEmission, ConstantTranslation, VaryingNodeError
from .materials.graph import Constant, Context, Source, Value, constant_of, is_implied, trace
from .node_graph import NodeGraph
from .plain import plain, settings_of

_BOUNCED = {"Ray Length": 1e4, "Ray Depth": 1.0}
LIGHT_PATHS = {
    "camera": {"Is Camera Ray": 1.0, "Ray Length": 1e4},
    "diffuse": {**_BOUNCED, "Is Diffuse Ray": 1.0, "Is Reflection Ray": 1.0, "Diffuse Depth": 1.0},
    "glossy": {**_BOUNCED, "Is Glossy Ray": 1.0, "Is Reflection Ray": 1.0, "Glossy Depth": 1.0},
    "transmission": {**_BOUNCED, "Is Glossy Ray": 1.0, "Is Transmission Ray": 1.0, "Transmission Depth": 1.0},
    "scatter": {**_BOUNCED, "Is Volume Scatter Ray": 1.0},
}
"""Outputs of the Light Path node by kind of ray, in the order of the native module's; the others are 0."""
KINDS_ALONE = {"Is Shadow Ray", *(name for path in LIGHT_PATHS.values() for name in path if name.startswith("Is "))}
"""Outputs that depend on nothing but the kind of a ray."""
UNSUPPORTED = {
    "ShaderNodeAttribute": "reads attributes",
    "ShaderNodeCameraData": "depends on the camera",
    "ShaderNodeScript": "is a script",
}
VALUES = {"ShaderNodeValue", "ShaderNodeRGB", "ShaderNodeNormal"}
"""Nodes that keep their value in an output."""
IMPLIED = {"Vector", "Normal", "Tangent"}
"""Inputs that imply a value where nothing is linked."""
CAMERA_SPACE = {("ShaderNodeTexCoord", "Camera"), ("ShaderNodeTexCoord", "Window")}
"""Outputs that depend on the camera."""


class UnsupportedNodeError(Exception):
    """A node cannot be rendered; the message names it."""


class Sides(NamedTuple):
    """Sockets of a node that mixes two inputs."""

    factor: bpy.types.NodeSocket
    first: bpy.types.NodeSocket
    second: bpy.types.NodeSocket
    is_second_alone: bool
    """True if factor 1 gives the second input alone."""


class WorldReader:
    """Follows the nodes of a world, past mixtures of which one side counts only."""

    def __init__(self, constant_emission: ConstantEmission | None = None, rays: str = "diffuse"):
        """`constant_emission` computes the value of nodes; without it only nodes that are constants themselves
        count. `rays` are of LIGHT_PATHS."""
        self.asked: set[str] = set()
        """Outputs of the Light Path node that anything depended on."""
        self._light_path = LIGHT_PATHS[rays]
        self._constant_emission = constant_emission

    def follow(self, socket: bpy.types.NodeSocket, context: Context) -> Source | Constant:
        """Traces like `trace`, also through Mix nodes with a factor of 0 or 1."""
        while True:
            source = trace(socket, context)
            sides = _sides(source.node) if isinstance(source, Source) else None
            if not isinstance(source, Source) or sides is None:
                return source
            factor = self.constant(sides.factor, source.context)
            if factor == 0.0:
                socket = sides.first
            elif factor == 1.0 and sides.is_second_alone:
                socket = sides.second
            else:
                return source
            context = source.context

    def emission(self, surface: bpy.types.NodeSocket, context: Context) -> list[float] | None:
        """Emission of a shader socket in all directions; None if it varies."""
        return self._computed(ConstantTranslation.emission, surface, context)

    def constant(self, socket: bpy.types.NodeSocket, context: Context) -> Value | None:
        """The value of a socket that only constants feed; None otherwise."""
        value = constant_of(self.follow(socket, context), socket)
        return value if value is not None else self._computed(ConstantTranslation.constant, socket, context)

    def _computed(self, compute: Any, socket: bpy.types.NodeSocket, context: Context) -> Any:
        if self._constant_emission is None:
            return None
        try:
            return compute(ConstantTranslation(self._constant_emission, self._of_light_path), socket, context)
        except VaryingNodeError:
            return None

    def _of_light_path(self, output: str) -> float:
        self.asked.add(output)
        return self._light_path.get(output, 0.0)


class WorldGraph(NodeGraph):
    """The nodes behind a surface shader of a world."""

    def __init__(self, surface: Source, reader: WorldReader):
        """Describes all nodes that feed a surface."""
        super().__init__()
        self._reader = reader
        self._numbers: dict[tuple[int, ...], int] = {}
        self.surface = self._link(surface)

    def take_strength(self) -> None:
        """Sets the surface, a Background node, to strength 1."""
        self.nodes[self.surface["node"]]["inputs"]["Strength"] = 1.0

    def _link(self, source: Source) -> dict[str, Any]:
        node, output = source.node, source.socket.identifier
        if (node.bl_idname, output) in CAMERA_SPACE:
            raise UnsupportedNodeError(f"node '{node.name}' ({output}) depends on the camera")
        key = (node.as_pointer(), *(group.as_pointer() for group in source.context))
        if key not in self._numbers:
            # The number first: the nodes behind come after.
            self._numbers[key] = len(self.nodes)
            self.nodes.append({})
            self.nodes[self._numbers[key]] |= self._node(node, source.context)
        return {"node": self._numbers[key], "output": output}

    def _node(self, node: bpy.types.Node, context: Context) -> dict[str, Any]:
        if node.bl_idname in UNSUPPORTED:
            raise UnsupportedNodeError(f"node '{node.name}' {UNSUPPORTED[node.bl_idname]}")
        inputs = {}
        for socket in node.inputs:
            if not socket.is_unavailable and (value := self._input(socket, context)) is not None:
                inputs[socket.identifier] = value
        return {
            "type": node.bl_idname,
            "settings": settings_of(node) | {"mute": False},
            "inputs": inputs,
            "value": plain(node.outputs[0].default_value) if node.bl_idname in VALUES else None,
            "parts": self._parts(node),
        }

    def _input(self, socket: bpy.types.NodeSocket, context: Context) -> Any:
        """Value of an input, or its link; None if it is implied."""
        source = self._reader.follow(socket, context)
        if isinstance(source, Source) and source.node.bl_idname != "ShaderNodeLightPath":
            return self._link(source)
        if socket.type == "SHADER" or not hasattr(socket, "default_value"):
            return None
        if isinstance(source, Constant) and source.owner == socket:
            return None if socket.hide_value else plain(socket.default_value)
        if socket.identifier in IMPLIED and is_implied(source, socket):
            return None
        value = self._reader.constant(socket, context)
        value = 0.0 if value is None else value
        own = plain(socket.default_value)
        if not isinstance(own, list):
            return value
        values = value if isinstance(value, list) else [value] * 3
        return [*values, *own[len(values) :]]

    def _parts(self, node: bpy.types.Node) -> dict[str, Any]:
        """Parts of a node besides its own settings."""
        parts: dict[str, Any] = {}
        for prop in node.bl_rna.properties:
            name = prop.identifier
            if name in bpy.types.Node.bl_rna.properties or name in {"color_mapping", "image_user"}:
                continue
            value = getattr(node, name) if prop.type in {"POINTER", "COLLECTION"} else None
            if value is None or (prop.type == "COLLECTION" and not len(value)):
                continue
            parts[name] = self._part(node, value)
        return parts

    def _part(self, node: bpy.types.Node, value: Any) -> Any:
        if isinstance(value, bpy.types.Image):
            self.images[value.name_full] = value
            return {"image": value.name_full}
        if isinstance(value, bpy.types.Object):
            return {"object": place_of(value)}
        if isinstance(value, bpy.types.ColorRamp):
            stops = [[stop.position, plain(stop.color)] for stop in value.elements]
            return {"settings": settings_of(value), "stops": stops}
        if isinstance(value, bpy.types.CurveMapping):
            curves = [[[plain(point.location), point.handle_type] for point in curve.points] for curve in value.curves]
            return {"settings": settings_of(value), "curves": curves}
        if isinstance(value, bpy.types.TexMapping):
            return {"settings": settings_of(value)}
        raise UnsupportedNodeError(f"node '{node.name}' ({node.bl_label})")


def place_of(obj: bpy.types.Object) -> list[list[float]]:
    """Rows of an object's matrix, to six digits: evaluating a file again may differ by a rounding."""
    return [[float(f"{cell:.6g}") for cell in row] for row in obj.matrix_world]


def _sides(node: bpy.types.Node) -> Sides | None:
    """Sides of a node that mixes; None for others."""
    if node.bl_idname == "ShaderNodeMixShader":
        return Sides(node.inputs[0], node.inputs[1], node.inputs[2], True)
    if node.bl_idname == "ShaderNodeMixRGB" and not node.use_clamp:
        return Sides(node.inputs[0], node.inputs[1], node.inputs[2], node.blend_type == "MIX")
    if node.bl_idname != "ShaderNodeMix" or node.data_type not in {"FLOAT", "RGBA"}:
        return None
    if node.data_type == "RGBA" and node.clamp_result:
        return None
    suffix = "Float" if node.data_type == "FLOAT" else "Color"
    sockets = {socket.identifier: socket for socket in node.inputs}
    is_mix = node.data_type == "FLOAT" or node.blend_type == "MIX"
    return Sides(sockets["Factor_Float"], sockets[f"A_{suffix}"], sockets[f"B_{suffix}"], is_mix)
