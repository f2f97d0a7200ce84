"""Attributes of any geometry as the colours that Cycles makes of them."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .arrays import LAYOUTS, stored
from .materials import FACTOR

UNREAD = {"INT16_2D", "INT32_2D"}
"""Types of attributes that Cycles does not read."""
BYTE = np.float32(1.0 / 255.0) * np.arange(256, dtype=np.float32)
LINEAR_BYTE = np.where(BYTE < 0.04045, BYTE / 12.92, ((BYTE + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""Scene-linear values of colours that are stored as sRGB bytes."""


def attribute_values(attribute: bpy.types.Attribute) -> np.ndarray:
    """A copy of an attribute's values; scene-linear of a colour."""
    values = stored(attribute.data, *LAYOUTS[attribute.data_type])
    if attribute.data_type != "BYTE_COLOR":
        return values.copy()
    colors = LINEAR_BYTE[values]
    colors[:, 3] = BYTE[values[:, 3]]
    return colors


def as_colors(attribute: bpy.types.Attribute) -> np.ndarray:
    """Colours that Cycles makes of any attribute, [N, 4]: numbers are grey, missing components of vectors are 0, alpha
    is 1."""
    values = attribute_values(attribute)
    width = 1 if values.ndim == 1 else values.shape[1]
    colors = np.zeros((len(values), 4), np.float32)
    colors[:, 3] = 1.0
    colors[:, : 3 if width == 1 else width] = values.reshape(-1, width)
    return colors


def as_factors(attribute: bpy.types.Attribute, colors: np.ndarray) -> np.ndarray:
    """The one number that Cycles makes of an attribute, as grey: u of a UV map, the mean of others."""
    is_uv = attribute.data_type == "FLOAT2"
    colors[:, :3] = colors[:, :1] if is_uv else colors[:, :3].mean(axis=1, keepdims=True)
    return colors


def attribute_colors(attribute: Any, name: str) -> np.ndarray | None:
    """Colours of an attribute, its factor where `name` says so; None of a type that Cycles does not read."""
    if attribute.data_type not in LAYOUTS.keys() - UNREAD:
        return None
    colors = as_colors(attribute)
    return as_factors(attribute, colors) if name.endswith(FACTOR) else colors
