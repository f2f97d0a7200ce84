"""Cycles' render settings in the JSON form of `relume_trace::TraceSettings`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import bpy

from .view_layer import render_layer

FARTHEST = 1e6
"""Metres beyond which nothing of a scene is looked for nearby."""


def trace_settings(scene: bpy.types.Scene, warn: Callable[[str], None]) -> dict[str, Any]:
    """Settings of a final Cycles render of the scene; Blender's defaults where Cycles is not enabled. `warn` gets a
    message for each that paths without lights cannot represent."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None:
        warn(f"scene '{scene.name}': Cycles is not enabled; its default settings are used")
        return {}
    clamps = max(cycles.sample_clamp_direct, cycles.sample_clamp_indirect)
    if clamps > 0.0:
        warn(f"scene '{scene.name}': clamping of samples is left out; Verify says how much light it takes from Cycles")
    glass = {"film_glass": cycles.film_transparent_roughness} if cycles.film_transparent_glass else {}
    return {
        "samples": cycles.samples,
        "seed": cycles.seed,
        "paths": {
            "bounces": {
                "total": cycles.max_bounces,
                "diffuse": cycles.diffuse_bounces,
                "glossy": cycles.glossy_bounces,
                "transmission": cycles.transmission_bounces,
                "volume": cycles.volume_bounces,
                "transparent": cycles.transparent_max_bounces,
                # Until 5.0, Cycles' paths went through one more than its lights.
                "more_transparent": int(bpy.app.version < (5, 0, 0)),
                "min_total": cycles.min_light_bounces,
                "min_transparent": cycles.min_transparent_bounces,
            },
            "filter_glossy": cycles.blur_glossy,
            "caustics_reflective": cycles.caustics_reflective,
            "caustics_refractive": cycles.caustics_refractive,
            "filter": _pixel_filter(scene, warn),
            "film_exposure": cycles.film_exposure,
            "film_transparent": scene.render.film_transparent,
            **(glass if scene.render.film_transparent else {}),
            **_fast_gi(scene, warn),
        },
    }


def _fast_gi(scene: bpy.types.Scene, warn: Callable[[str], None]) -> dict[str, Any]:
    """Fast GI Approximation, in the cases in which Cycles heeds it."""
    cycles, world = scene.cycles, render_layer(scene).world_override or scene.world
    if not cycles.use_fast_gi or world is None or world.light_settings.ao_factor == 0.0:
        return {}
    shared = {"distance": min(world.light_settings.distance, FARTHEST), "factor": world.light_settings.ao_factor}
    if cycles.fast_gi_method == "ADD":
        return {"fast_gi": {"method": "add", **shared}}
    bounces = cycles.ao_bounces_render
    if not bounces:
        return {}
    lamps = (obj.data.cycles for obj in scene.objects if obj.type == "LIGHT")
    if any(lamp.use_multiple_importance_sampling for lamp in lamps):
        warn(
            f"scene '{scene.name}': large lamps beyond the distance of Fast GI Approximation are brighter than in "
            "Cycles, whose shortened rays miss them, unless their Multiple Importance is off"
        )
    return {"fast_gi": {"method": "replace", "bounces": bounces, **shared}}


def _pixel_filter(scene: bpy.types.Scene, warn: Callable[[str], None]) -> dict[str, Any]:
    cycles = scene.cycles
    if cycles.pixel_filter_type == "BOX":
        return {"type": "box"}
    if cycles.pixel_filter_type == "GAUSSIAN":
        return {"type": "gaussian", "width": cycles.filter_width}
    return {"type": "blackman_harris", "width": cycles.filter_width}
