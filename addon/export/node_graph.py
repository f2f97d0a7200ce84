"""Nodes as plain data, from which another Blender builds the same ones as a world and has Cycles render them."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import bpy

from .plain import settings_of


class WorldRenderError(Exception):
    """Cycles could not render a world; the message says why."""


class NodeGraph:
    """Nodes behind the surface of a world, each with its type, settings and inputs."""

    def __init__(self) -> None:
        """Describes nothing yet."""
        self.nodes: list[dict[str, Any]] = []
        self.images: dict[str, bpy.types.Image] = {}
        """Images by their full names."""
        self.surface: dict[str, Any] = {}
        """Link to what is shown."""

    @property
    def content(self) -> dict[str, Any]:
        """All but the images' pixels, for JSON."""
        return {"surface": self.surface, "nodes": self.nodes}

    @property
    def text(self) -> str:
        """Text that is equal for equal worlds."""
        return json.dumps(self.content, sort_keys=True)


class SkyGraph(NodeGraph):
    """A Sky Texture, as a world that shows nothing else. The mapping in its properties is left out."""

    def __init__(self, node: bpy.types.Node):
        """Describes a node of any tree."""
        super().__init__()
        shown = {"settings": settings_of(node) | {"mute": False}, "inputs": {}, "value": None, "parts": {}}
        self.nodes = [{"type": node.bl_idname, **shown}]
        self.surface = {"node": 0, "output": "Color"}


TextureOf = Callable[[NodeGraph, str], Any]
"""Number of a texture of a world, rendered over all directions; the name is for messages. Raises WorldRenderError."""


def no_texture(_graph: NodeGraph, _name: str) -> Any:
    """Renders nothing."""
    raise WorldRenderError("there is no other Blender to render it")
