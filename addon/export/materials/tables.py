"""Ramps and curves baked to tables of Cycles' size, so that both interpolate alike."""

from __future__ import annotations

from typing import Any

import bpy

SIZE = 256
"""Entries of a ramp or curve table in Cycles (`RAMP_TABLE_SIZE`)."""


def color_ramp(ramp: bpy.types.ColorRamp) -> dict[str, Any]:
    """The JSON form of `Curve` for a color ramp."""
    table = [list(ramp.evaluate(index / (SIZE - 1))) for index in range(SIZE)]
    constant = ramp.interpolation == "CONSTANT"
    return {"min": 0.0, "max": 1.0, "table": table, "interpolate": not constant, "extrapolate": False}


def rgb_curves(mapping: bpy.types.CurveMapping) -> dict[str, Any]:
    """The JSON form of `Curve` for RGB curves: the combined curve first, then each channel's."""
    mapping.initialize()
    red, green, blue, combined = mapping.curves
    low, high = _domain(mapping.curves)

    def entry(position: float) -> list[float]:
        value = mapping.evaluate(combined, position)
        return [*(mapping.evaluate(curve, value) for curve in (red, green, blue)), 1.0]

    return _table(low, high, entry, mapping)


def rgb_curves_at(mapping: bpy.types.CurveMapping, color: list[float]) -> list[float]:
    """A colour after it has passed RGB curves."""
    mapping.initialize()
    *channels, combined = mapping.curves
    return [
        mapping.evaluate(curve, mapping.evaluate(combined, value)) for curve, value in zip(channels, color, strict=True)
    ]


def vector_curves(mapping: bpy.types.CurveMapping) -> dict[str, Any]:
    """The JSON form of `Curve` for vector curves, one for each component."""
    mapping.initialize()
    low, high = _domain(mapping.curves)
    return _table(low, high, lambda at: [*(mapping.evaluate(curve, at) for curve in mapping.curves), 1.0], mapping)


def float_curve(mapping: bpy.types.CurveMapping) -> dict[str, Any]:
    """The JSON form of `Curve` for a float curve, equal in all channels."""
    mapping.initialize()
    curve = mapping.curves[0]
    low, high = _domain([curve])
    return _table(low, high, lambda position: [mapping.evaluate(curve, position)] * 3 + [1.0], mapping)


def _domain(curves: Any) -> tuple[float, float]:
    """The span of all curves' points."""
    positions = [point.location[0] for curve in curves for point in curve.points]
    return min(positions, default=0.0), max(positions, default=1.0)


def _table(low: float, high: float, entry: Any, mapping: bpy.types.CurveMapping) -> dict[str, Any]:
    high = high if high > low else low + 1.0
    table = [entry(low + (high - low) * index / (SIZE - 1)) for index in range(SIZE)]
    extrapolate = mapping.extend == "EXTRAPOLATED"
    return {"min": low, "max": high, "table": table, "interpolate": True, "extrapolate": extrapolate}
