"""Settings of any part of a file as plain values, for fingerprints and for handing them to another Blender."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

LOOKS_ONLY = {
    "active_generation_index", "active_index", "active_input_index", "active_instanceweight_index", "active_item",
    "active_main_index", "active_output_index", "active_particle_target_index", "active_texture",
    "active_texture_index",
    "color", "height", "hide", "label", "location", "location_absolute", "name", "parent", "select", "use_custom_color",
    "warning_propagation", "width",
}  # fmt: skip
"""Properties of nodes, modifiers and particles without effect on their result."""
SIMPLE = {"BOOLEAN", "INT", "FLOAT", "ENUM", "STRING"}


def effective_properties(struct: Any) -> Iterator[bpy.types.Property]:
    """Properties that can be set and change the result of a node, modifier or data-block."""
    for prop in struct.bl_rna.properties:
        name = prop.identifier
        if prop.is_readonly or name in LOOKS_ONLY or name.startswith(("show_", "bl_", "is_", "use_fake", "select")):
            continue
        yield prop


def settings_of(struct: Any) -> dict[str, Any]:
    """Simple settings of any part of a file, by name."""
    simple = (prop.identifier for prop in effective_properties(struct) if prop.type in SIMPLE)
    return {name: plain(getattr(struct, name)) for name in simple}


def plain(value: Any) -> Any:
    """A value whose text is the same for the same setting."""
    if isinstance(value, bpy.types.ID):
        return value.name_full
    if isinstance(value, (bool, int, float, str, set)) or value is None:
        return sorted(value) if isinstance(value, set) else value
    # The vectors of `mathutils` have no `__iter__`.
    return [plain(entry) for entry in value] if hasattr(value, "__len__") else type(value).__name__
