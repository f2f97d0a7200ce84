"""Reasons why a property may not be written."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy


class RefusedError(Exception):
    """Nothing was written. `reasons` has a line for each thing in the way, by name."""

    def __init__(self, reasons: list[str]):
        super().__init__("; ".join(reasons))
        self.reasons = reasons


def why_not(block: bpy.types.ID, *paths: str, label: str = "") -> str | None:
    """Reason why one of the properties cannot be written, to be put behind a name; None if all can. `label` replaces a
    path that is no name for the artist."""
    if not block.is_editable:
        return "is linked from another file: make it local or override it"
    for writer, owned_paths in (("a driver", _drivers(block)), ("animation", _animated(block))):
        path = next((path for path in owned_paths if path in paths), None)
        if path is not None:
            return f"has {writer} on its {label or path.replace('_', ' ')}"
    return None


def _drivers(block: bpy.types.ID) -> Iterator[str]:
    if block.animation_data:
        yield from (curve.data_path for curve in block.animation_data.drivers)


def _animated(block: bpy.types.ID) -> Iterator[str]:
    data = block.animation_data
    if not data:
        return
    if data.action:
        yield from _curves(data.action, getattr(data, "action_slot", None))
    for track in data.nla_tracks:
        for strip in track.strips:
            if strip.action:
                yield from _curves(strip.action, getattr(strip, "action_slot", None))


def _curves(action: bpy.types.Action, slot: Any) -> Iterator[str]:
    """Paths of an action; from Blender 4.4 on, of one of its slots."""
    if bpy.app.version < (4, 4, 0):
        yield from (curve.data_path for curve in action.fcurves)
        return
    for layer in action.layers:
        for strip in layer.strips:
            for bag in strip.channelbags:
                if slot is not None and bag.slot_handle == slot.handle:
                    yield from (curve.data_path for curve in bag.fcurves)
