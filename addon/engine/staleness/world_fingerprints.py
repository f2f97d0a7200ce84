"""Fingerprints of the world: of its light, and of the medium that fills all space."""

from __future__ import annotations

from typing import Any

import bpy

from ...core.diff import Fingerprint, color_text
from ...export.images import path_of
from ...export.materials import MaterialExporter
from ...export.materials.graph import has_volume
from ...export.node_graph import NodeGraph, SkyGraph
from ...export.plain import settings_of
from ...export.point_images import PointImage
from ...export.view_layer import render_layer
from ...export.world import export_world, world_of
from ..native import native
from .node_fingerprints import hashed


class _WorldRecorder:
    """Scene builder and exporter that only records what `export_world` passes to them."""

    def __init__(self, frame: int) -> None:
        self.frame = frame
        self.color = [0.0, 0.0, 0.0]
        self.shape: list[Any] = []

    def set_world(self, color: list[float], texture: Any = None, **shape: Any) -> None:
        """Records the world; called like the scene builder's method."""
        self.color, self.shape = color, [texture, sorted(shape.items())]
        if "parts" in shape:  # No strength is that of the whole.
            self.shape.append(color)

    def number(self, image: bpy.types.Image, _owner: str, settings: bpy.types.ImageUser) -> str:
        """Identifies an image with its settings; called like the image exporter's method."""
        path = path_of(image, settings, self.frame) if image.source == "SEQUENCE" else image.filepath
        return repr([image.name_full, path, image.colorspace_settings.name, image.alpha_mode])

    def tiles(self, image: bpy.types.Image, _owner: str) -> list[str]:
        """Identifies an image of tiles; called like the image exporter's method."""
        return [image.name_full]

    def sky(self, node: bpy.types.Node) -> str:
        """Identifies a Sky Texture; called like the image exporter's method."""
        return SkyGraph(node).text

    def points(self, node: bpy.types.Node) -> PointImage:
        """Identifies a 3D image of points; called like the image exporter's method."""
        settings = [settings_of(node), node.object.name_full]
        return PointImage(repr(settings), node.resolution, node.object.matrix_world.inverted_safe())

    def missing(self, _owner: str) -> str:
        """Stands for an image that is not there."""
        return ""

    def add_material(self, text: str) -> int:
        """Records a material, as of the world's volume; called like the scene builder's method."""
        self.shape.append(text)
        return 0

    def texture_of(self, graph: NodeGraph, _name: str) -> str:
        """Identifies a world's node graph by its text, in place of rendering it."""
        return graph.text

    def constant_emission(self, shader: str) -> Any:
        """Computes what a shader emits everywhere, as the scene builder does."""
        return native().SceneBuilder.constant_emission(shader)

    def warn(self, message: str) -> None:
        """Records a feature that cannot be represented: it is a part of the world too."""
        self.shape.append(message)


def world(scene: bpy.types.Scene) -> Fingerprint:
    """Fingerprint of the scene's world."""
    recorder: Any = _WorldRecorder(scene.frame_current)
    export_world(recorder, recorder, recorder.texture_of, scene, render_layer(scene))
    return {"shape": hashed(recorder.shape), "color": color_text(recorder.color)}


def space(scene: bpy.types.Scene) -> Fingerprint:
    """Fingerprint of the medium that fills all space."""
    found = world_of(scene, render_layer(scene))
    if found is None or not has_volume(found):
        return {"volume": ""}
    recorder: Any = _WorldRecorder(scene.frame_current)
    MaterialExporter(recorder, recorder).world_volume(found)
    return {"volume": hashed(recorder.shape)}
