"""Subsurface scattering: the sockets of a node, and what they mean in this Blender."""

from __future__ import annotations

import math
from typing import Any

import bpy

from .graph import Context
from .translation import Translation

METHODS = {"BURLEY": "disk", "RANDOM_WALK_SKIN": "skin"}
"""Ways through a body by Blender's names; all others are walks."""
HAS_TRUE_RADIUS = bpy.app.version >= (5, 2, 0)
"""True if *Random Walk* takes its radius for the mean free path. Before, it was what is *Random Walk (Legacy)* now."""
IS_WALKED_ONCE = bpy.app.version < (5, 0, 0)
"""True if paths that have scattered diffusely walk through no body."""
LEAST_FOOTPRINT = 0.25 if bpy.app.version < (4, 4, 0) else 0.0
"""Radius in pixels below which a body is diffuse."""


def subsurface(t: Translation, node: bpy.types.Node, context: Context, method: str, prefix: str = "") -> dict[str, Any]:
    """The sockets of a node whose names begin with `prefix`, and their meaning."""
    return {
        "radius": t.value(node, f"{prefix}Radius", context, [1.0, 0.2, 0.1]),
        "scale": t.value(node, f"{prefix}Scale", context, 0.05),
        "ior": t.value(node, f"{prefix}IOR", context, 1.4),
        "anisotropy": t.value(node, f"{prefix}Anisotropy", context, 0.0),
        "model": model(method),
    }


def model(method: str) -> dict[str, Any]:
    """The meaning of a method's sockets."""
    is_true = method == "RANDOM_WALK" and HAS_TRUE_RADIUS
    keeps_radius = is_true or method == "RANDOM_WALK_SKIN"
    limits = [-0.99, 0.99 if is_true else 0.9] if HAS_TRUE_RADIUS else [0.0, 0.9]
    return {
        "method": METHODS.get(method, "walk"),
        "inversion": "van_de_hulst" if is_true else "polynomial",
        "radius_factor": 1.0 if keeps_radius else 0.25 / math.pi,
        "anisotropy_limits": limits,
        "least_footprint": LEAST_FOOTPRINT,
        "is_first_only": method == "BURLEY" or IS_WALKED_ONCE,
    }
