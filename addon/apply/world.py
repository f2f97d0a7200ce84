"""Writes a gain into the world."""

from __future__ import annotations

import bpy

from ..core.rows import NEUTRAL
from ..export.materials.graph import resolve, used_tree
from .writable import why_not


class WorldWrite:
    """The world times a gain: brightness goes into the strength of its Background node, a tint into its colour."""

    def __init__(self, world: bpy.types.World | None, gain: list[float]):
        self.world = world
        self.gain = gain
        self.strength = max(gain)
        self.tint = [channel / self.strength for channel in gain] if self.strength > 0.0 else NEUTRAL

    def refusal(self) -> str | None:
        """Reason why the world cannot be written, with its name; None if it can."""
        if self.world is None or self.gain == NEUTRAL:
            return None
        reason = why_not(self.world, "color") if used_tree(self.world) is None else self._node_refusal()
        return f"world '{self.world.name}' {reason}" if reason else None

    def write(self) -> None:
        """Writes the world. Call it only without a refusal."""
        if self.world is None or self.gain == NEUTRAL:
            return
        node = self._background()
        if node is None:
            self.world.color = [old * factor for old, factor in zip(self.world.color, self.gain, strict=True)]
            return
        node.inputs["Strength"].default_value *= self.strength
        if self._is_tinted:
            color = node.inputs["Color"].default_value
            color[:3] = [old * factor for old, factor in zip(color[:3], self.tint, strict=True)]

    @property
    def _is_tinted(self) -> bool:
        return self.tint != NEUTRAL

    def _background(self) -> bpy.types.Node | None:
        """The Background node that the world's output shows, unless it is inside of a group."""
        tree = used_tree(self.world)
        output = tree.get_output_node("CYCLES") if tree else None
        source = resolve(output.inputs["Surface"], ()) if output else None
        if source is None or source.context or source.node.bl_idname != "ShaderNodeBackground":
            return None
        return source.node

    def _node_refusal(self) -> str | None:
        node, tree = self._background(), used_tree(self.world)
        if node is None:
            return "is not one Background node: set its row to neutral, or change the world by hand"
        names = ("Strength", "Color") if self._is_tinted else ("Strength",)
        for name in names:
            socket = node.inputs[name]
            if socket.is_linked:
                return f"has nodes that feed its {name.lower()}: only an unlinked value can be written"
            reason = why_not(tree, socket.path_from_id("default_value"), label=name.lower())
            if reason:
                return reason
        return None
