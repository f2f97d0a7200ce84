"""Fingerprint of what motion blur depends on besides the frame itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
import numpy as np

from ...core.diff import Fingerprint
from ...export.motion import shutter_of
from ...export.view_layer import render_layer
from .node_fingerprints import hashed

KEY_PARTS = {"co": 2, "handle_left": 2, "handle_right": 2}


def motion(scene: bpy.types.Scene) -> Fingerprint:
    """The shutter, and all that is animated where there is blur. Drivers, physics and constraints are seen by what
    they do in the frame alone."""
    shutter = shutter_of(scene, render_layer(scene))
    if shutter is None:
        return {"shutter": "none"}
    return {
        "shutter": hashed([shutter.duration, shutter.frame_seconds, shutter.curve, shutter.rolling]),
        "frame": f"{shutter.center:.6g}",
        "animation": hashed([_curve(curve) for action in bpy.data.actions for curve in _curves(action)]),
    }


def _curves(action: bpy.types.Action) -> Iterator[bpy.types.FCurve]:
    """Curves of an action, in all its layers from Blender 4.4 on."""
    if not hasattr(action, "layers"):
        yield from action.fcurves
        return
    for layer in action.layers:
        for strip in layer.strips:
            for bag in getattr(strip, "channelbags", ()):
                yield from bag.fcurves


def _curve(curve: bpy.types.FCurve) -> list[Any]:
    points = curve.keyframe_points
    arrays = []
    for part, width in KEY_PARTS.items():
        values = np.empty(width * len(points), np.float32)
        points.foreach_get(part, values)
        arrays.append(hashed(values.tobytes()))
    kinds = [point.interpolation for point in points]
    return [curve.data_path, curve.array_index, curve.mute, curve.extrapolation, arrays, kinds]
