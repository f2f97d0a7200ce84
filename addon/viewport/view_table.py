"""Tables for shaders, from scene-linear pixels to the colours of the scene's view (`export.color_table`).

A Blender in the background colours the entries (`engine.workers.view_worker`), so that the window never stands still.
The plain sRGB curve needs no table."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ..engine.workers import view_worker
from ..export import false_color
from ..export.color_table import LOG_MAX, Table, color_table
from ..export.view_transform import SHAPER_MIN, SHAPER_OFFSET, is_srgb_view, view_key, view_settings
from ..export.working_space import rec709_from_scene_linear

MOST_TABLES = 4
"""Tables that are kept for views seen before."""

_tables: dict[str, Table] = {}
"""Newest tables, by `_key`."""
_shown: dict[int, Table] = {}
"""Newest table of each scene, good enough until the next one is there."""


@dataclass(frozen=True, eq=False)
class ViewTable:
    """Display colour = `table(color * scale)`, or without a table the sRGB curve of it in Rec.709 `** exponent`."""

    table: np.ndarray | None
    """[blue, green, red, 4], entries spaced as `export.view_transform.shaper_axis` up to LOG_MAX."""
    scale: float
    exponent: float
    levels: np.ndarray | None = None
    """Display colours [LEVELS, 3] of which the table holds the places, 0..1, where the view jumps between them."""
    to_rec709: np.ndarray = field(default_factory=lambda: np.eye(3, dtype=np.float32))
    """Matrix [3, 3] from scene-linear; used where there is no table."""

    def apply(self, colors: np.ndarray) -> np.ndarray:
        """Display colours, 0..1, of opaque scene-linear ones, [..., 3]."""
        scaled = np.maximum(np.nan_to_num(colors, posinf=1e30) * self.scale, 0.0)
        if self.table is None:
            return srgb_from_linear(scaled @ self.to_rec709.T) ** self.exponent
        sampled = _sample(self.table, scaled)
        return sampled if self.levels is None else false_color.look_up(self.levels, sampled[..., 0])


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """The sRGB curve (IEC 61966-2-1), clipped to 0..1."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def of(scene: bpy.types.Scene) -> ViewTable | None:
    """The view of a scene as far as it is known; None until its first table is there. Costs nothing."""
    settings = scene.view_settings
    if is_srgb_view(scene):
        exponent = 1.0 / max(settings.gamma, 1e-6)
        return ViewTable(None, 2.0**settings.exposure, exponent, to_rec709=rec709_from_scene_linear())
    table = _tables.get(_key(scene)) or _shown.get(scene.session_uid)
    if table is None:
        return None
    _shown[scene.session_uid] = table
    _forget(_shown)
    entries, levels = table
    return ViewTable(entries, 1.0 if settings.use_curve_mapping else 2.0**settings.exposure, 1.0, levels)


def is_complete(scene: bpy.types.Scene) -> bool:
    """True if nothing is left to do for `work`."""
    return is_srgb_view(scene) or _key(scene) in _tables


def work(scene: bpy.types.Scene) -> bool:
    """Polls the making of the table; returns True if it came. Raises OSError."""
    if is_complete(scene):
        return False
    try:
        worker = view_worker.shared()
        worker.ask(view_worker.table_of(_settings(scene)))
        table = worker.turn()
    except OSError:
        if bpy.app.is_job_running("RENDER"):  # It would write its pictures with our settings.
            raise
        complete(scene)  # Where there can be no other Blender this one stands still for a moment.
        return True
    if table is None:
        return False
    _keep(scene, table)
    return True


def complete(scene: bpy.types.Scene) -> ViewTable:
    """Full view of a scene, computed at once, for pictures that are not drawn live."""
    if not is_complete(scene):
        _keep(scene, color_table(scene))
    view = of(scene)
    assert view is not None
    return view


def clear() -> None:
    """Forgets all tables."""
    _tables.clear()
    _shown.clear()


def _keep(scene: bpy.types.Scene, table: Table) -> None:
    _tables[_key(scene)] = table
    _forget(_tables)


def _forget(tables: dict) -> None:
    """Drops the oldest."""
    while len(tables) > MOST_TABLES:
        del tables[next(iter(tables))]


def _settings(scene: bpy.types.Scene) -> dict[str, Any]:
    """All that the table depends on. Exposure multiplies before it, except where there are curves."""
    return view_settings(scene, with_exposure=scene.view_settings.use_curve_mapping)


def _key(scene: bpy.types.Scene) -> str:
    return view_key(scene, with_exposure=scene.view_settings.use_curve_mapping)


def _sample(table: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """Trilinear look-up, as the shader does it."""
    last = len(table) - 1
    at = (np.log2(colors + SHAPER_OFFSET) - SHAPER_MIN) * (last / (LOG_MAX - SHAPER_MIN))
    at = np.clip(at, 0.0, last)
    low = np.minimum(at.astype(int), last - 1)
    high_part = at - low
    out = np.zeros(colors.shape, np.float64)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, high_part, 1.0 - high_part), axis=-1)
        red, green, blue = (low[..., channel] + corner[channel] for channel in range(3))
        out += weight[..., None] * table[blue, green, red, :3]
    return out
