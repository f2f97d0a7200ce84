"""Passes that a view layer asks for and a final render of this engine does not write."""

from __future__ import annotations

from collections.abc import Iterator

import bpy

from ...core.words import listed
from .data_passes import why_no_vector

PREFIX = "use_pass_"
WRITTEN = {
    *("combined", "z", "normal", "diffuse_color", "position", "uv", "object_index", "material_index"),
    *("cryptomatte_object", "cryptomatte_material", "cryptomatte_asset", "cryptomatte_accurate"),
    *("shadow_catcher", "grease_pencil", "vector"),
}
"""Passes that are written, Blender's own of grease pencil, and what only says how a pass is made."""


def unwritten_passes(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> str:
    """Words for the passes that are missing in a file of this layer of a scene; empty if there are none."""
    names = list(dict.fromkeys(_names(layer)))
    if layer.use_pass_vector and (reason := why_no_vector(scene)):
        names.insert(0, f"Vector ({reason})")
    return f"view layer '{layer.name}': not written are its passes {listed(names)}" if names else ""


def _names(layer: bpy.types.ViewLayer) -> Iterator[str]:
    for owner in filter(None, (layer, getattr(layer, "cycles", None))):
        for setting in owner.bl_rna.properties:
            plain = setting.identifier.removeprefix(PREFIX)
            if plain not in {setting.identifier, *WRITTEN} and getattr(owner, setting.identifier):
                yield setting.name
    yield from (aov.name for aov in layer.aovs)
    yield from (group.name for group in layer.lightgroups)
