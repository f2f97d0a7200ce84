"""Shaders of lamps and worlds that emit the same everywhere. The tracer computes the value of their nodes."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import bpy

from ...core.blackbody import blackbody_color
from ..object_attributes import Surroundings
from .closures import CLOSURES
from .exporter import TABLES
from .graph import NUMBERS, Context, Source, Value
from .translation import Translation

ConstantEmission = Callable[[str], tuple[list[float] | None, int | None]]
"""`relume.SceneBuilder.constant_emission`."""

EMITTERS = {
    "ShaderNodeEmission",
    "ShaderNodeBackground",
    "ShaderNodeBsdfPrincipled",
    "ShaderNodeMixShader",
    "ShaderNodeAddShader",
}
"""Shaders that count in a lamp or world; others emit nothing."""
PURE_NODES = {
    *("ShaderNodeMix", "ShaderNodeMixRGB", "ShaderNodeMath", "ShaderNodeVectorMath", "ShaderNodeMapRange"),
    *("ShaderNodeClamp", "ShaderNodeValToRGB", "ShaderNodeRGBCurve", "ShaderNodeFloatCurve"),
    *("ShaderNodeHueSaturation", "ShaderNodeBrightContrast", "ShaderNodeGamma", "ShaderNodeInvert"),
    *("ShaderNodeRGBToBW", "ShaderNodeSeparateColor", "ShaderNodeSeparateRGB", "ShaderNodeSeparateHSV"),
    *("ShaderNodeCombineColor", "ShaderNodeCombineRGB", "ShaderNodeCombineHSV", "ShaderNodeSeparateXYZ"),
    "ShaderNodeCombineXYZ",
}
"""Nodes that depend on their inputs alone."""


class VaryingNodeError(Exception):
    """A shader does not emit the same everywhere; `node` is one that varies."""

    def __init__(self, node: bpy.types.Node):
        """Error about a node whose output varies."""
        super().__init__(f"node '{node.name}' ({node.bl_label}) varies")
        self.node = node


class ConstantTranslation(Translation):
    """The graph of a lamp or world, in which nodes that vary stand for themselves."""

    def __init__(self, compute: ConstantEmission, light_path: Callable[[str], float | None], is_sun: bool = False):
        """`light_path` gives the value of an output of the Light Path node, if it is the same for all that the light
        meets."""
        images: Any = None  # Images vary.
        super().__init__(None, images, TABLES, None, "", Surroundings())
        self.glow = 0.1 if bpy.app.version < (4, 5, 0) else 1.0
        self.compute = compute
        self.light_path = light_path
        self.is_sun = is_sun
        self.varying: dict[int, bpy.types.Node] = {}
        self._present: list[bpy.types.Node] = []
        """The nodes in translation."""

    def emission(self, surface: bpy.types.NodeSocket, context: Context) -> list[float] | None:
        """Emission of a shader socket; None if it has no shader. Raises VaryingNodeError."""
        number = self.shader(surface, context)
        return None if number is None else self._computed(number)

    def constant(self, socket: bpy.types.NodeSocket, context: Context) -> Value:
        """The value of a socket. Raises VaryingNodeError."""
        value = self.socket_value(socket, context)
        color = self._computed(self.emit({"type": "emission", "color": value, "strength": 1.0}))
        return color[0] if socket.type in NUMBERS else color

    def _computed(self, surface: int) -> list[float]:
        color, varying = self.compute(json.dumps({"name": "", "nodes": self.nodes, "surface": surface}))
        if color is None:
            raise VaryingNodeError(self.varying[varying if varying is not None else -1])
        return color

    def _closure(self, source: Source) -> int | None:
        if source.node.bl_idname not in EMITTERS:
            return None
        self._present.append(source.node)
        number = CLOSURES[source.node.bl_idname](self, source.node, source.context)
        self._present.pop()
        if number is not None:
            self.varying[number] = source.node
        return number

    def _output(self, source: Source) -> Any:
        node, output = source.node, source.socket.identifier
        if node.bl_idname == "ShaderNodeLightPath" and (value := self.light_path(output)) is not None:
            return value
        if node.bl_idname == "ShaderNodeLightFalloff" and self._is_plain(source):
            return self.value(node, "Strength", source.context)
        if node.bl_idname == "ShaderNodeBlackbody":
            kelvin = self.constant(node.inputs["Temperature"], source.context)
            return blackbody_color(kelvin if isinstance(kelvin, float) else kelvin[0])
        if node.bl_idname not in PURE_NODES:
            return self._varies(node)
        self._present.append(node)
        value = super()._output(source)
        self._present.pop()
        return value

    def _is_plain(self, falloff: Source) -> bool:
        """True if a Light Falloff node gives its strength, as that of a lamp without nodes. Before Blender 4.5 it
        multiplies that of a sun by its distance, which is none, so that the sun is black."""
        is_quadratic = falloff.socket.identifier == "Quadratic"
        if self.is_sun:
            return is_quadratic or bpy.app.version >= (4, 5, 0)
        return is_quadratic and self.value(falloff.node, "Smooth", falloff.context) == 0.0

    def _varies(self, node: bpy.types.Node) -> dict[str, Any]:
        number = self.emit({"type": "geometry"})
        self.varying[number] = node
        return {"node": number, "output": "position"}

    def warn(self, _message: str) -> None:
        """Raises VaryingNodeError: an input that is not represented is no constant."""
        raise VaryingNodeError(self._present[-1])
