"""Coordinates of textures: links of their Vector input, and the mapping in their properties."""

from __future__ import annotations

from typing import Any

import bpy

from .graph import Source
from .translation import Translation

AXES = {"X": "x", "Y": "y", "Z": "z"}


def is_mapped(node: bpy.types.Node) -> bool:
    """True if the mapping in a texture's properties does anything. White noise has no such mapping."""
    mapping = getattr(node, "texture_mapping", None)
    if mapping is None:
        return False
    is_moved = any(mapping.translation) or any(mapping.rotation) or any(scale != 1.0 for scale in mapping.scale)
    return is_moved or _axes(mapping) != ("X", "Y", "Z")


def texture_vector(t: Translation, source: Source, implied: dict[str, Any]) -> Any:
    """Vector at which a texture is looked up; None for its default without a link, which is `implied` as a node."""
    node = source.node
    vector = t.value(node, "Vector", source.context, None)
    if not is_mapped(node):
        return vector
    if vector is None:
        vector = {"node": t.emit(implied), "output": "vector"}
    return _mapped(t, vector, node.texture_mapping)


def _axes(mapping: bpy.types.TexMapping) -> tuple[str, str, str]:
    return mapping.mapping_x, mapping.mapping_y, mapping.mapping_z


def _mapped(t: Translation, vector: Any, mapping: bpy.types.TexMapping) -> Any:
    """Applies a mapping in Cycles' order: axes are exchanged, then moved. Cycles ignores the limits."""
    if _axes(mapping) != ("X", "Y", "Z"):
        parts = t.emit({"type": "separate_xyz", "vector": vector})
        components = [{"node": parts, "output": AXES[axis]} if axis in AXES else 0.0 for axis in _axes(mapping)]
        vector = {
            "node": t.emit({"type": "combine_xyz"} | dict(zip("xyz", components, strict=True))),
            "output": "vector",
        }
    settings = {
        "kind": mapping.vector_type.lower(),
        "location": list(mapping.translation),
        "rotation": list(mapping.rotation),
        "scale": list(mapping.scale),
    }
    return {"node": t.emit({"type": "mapping", "vector": vector, **settings}), "output": "vector"}
