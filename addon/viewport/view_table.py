"""How scene-linear pixels become what the scene's view shows, as a table for shaders.

Blender colours the entries of the table itself (`export.view_transform`), a slice at a time, so that the window never
stands still: first a coarse table, then a fine one. Exposure multiplies before the table, so dragging it bakes
nothing, unless the view has curves, which Blender applies before exposure. The plain sRGB curve needs no table. Of a
view that jumps from one colour to the next the table holds places in a list of colours (`false_color`).
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np

from ..export.view_transform import SHAPER_MIN, SHAPER_OFFSET, displayed_in_slices, is_srgb_view, shaper_axis, view_key
from ..export.working_space import rec709_from_scene_linear
from . import false_color

LOG_MAX = 10.0
"""Logarithm of the brightest value of the table. Filmic tells colours apart up to about 2^10."""
COARSE, FINE = 45, 89
"""Entries along an axis: half and quarter stops, so that the clipping of "Standard" at 1.0 falls on an entry."""
KEPT = 4
"""Tables that are kept for views seen before."""

Table = tuple[np.ndarray, np.ndarray | None]
"""`View.table` and `View.levels`."""

_tables: dict[tuple, Table] = {}
_baking: dict[int, tuple[tuple, Iterator[Table | None]]] = {}
"""By scene: the view and its table in the making."""
_shown: dict[int, Table] = {}
"""By scene: the newest table, good enough until the next one is there."""


@dataclass(frozen=True, eq=False)
class View:
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
        found = _sample(self.table, scaled)
        return found if self.levels is None else false_color.look_up(self.levels, found[..., 0])


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    """The sRGB curve (IEC 61966-2-1), clipped to 0..1."""
    x = np.clip(linear, 0.0, 1.0)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def of(scene: bpy.types.Scene) -> View | None:
    """The view of a scene as far as it is known; None until `work` has made its first table. Costs nothing."""
    settings = scene.view_settings
    if is_srgb_view(scene):
        exponent = 1.0 / max(settings.gamma, 1e-6)
        return View(None, 2.0**settings.exposure, exponent, to_rec709=rec709_from_scene_linear())
    table = _tables.get(_key(scene, FINE))
    if table is None:
        table = _tables.get(_key(scene, COARSE))
    if table is None:
        table = _shown.get(scene.session_uid)
    if table is None:
        return None
    _shown[scene.session_uid] = table
    _forget(_shown)
    return View(table[0], 1.0 if settings.use_curve_mapping else 2.0**settings.exposure, 1.0, table[1])


def is_complete(scene: bpy.types.Scene) -> bool:
    """Whether there is nothing left to do for `work`."""
    return is_srgb_view(scene) or _key(scene, FINE) in _tables


def work(scene: bpy.types.Scene) -> bool:
    """Colours one slice of the scene's table; whether a better table came of it. Not while drawing."""
    baking = _baking.pop(scene.session_uid, (None, None))
    if is_complete(scene):
        return False
    size = FINE if _key(scene, COARSE) in _tables else COARSE
    key = _key(scene, size)
    slices = baking[1] if baking[0] == key else _slices(scene, size)
    try:
        table = next(slices)
    except ReferenceError:  # Undo has made another scene of it: the next turn begins again.
        return False
    if table is None:
        _baking[scene.session_uid] = key, slices
        return False
    _tables[key] = table
    _forget(_tables)
    return True


def complete(scene: bpy.types.Scene) -> View:
    """The view of a scene in full, at once: for what is not drawn live."""
    while not is_complete(scene):
        work(scene)
    view = of(scene)
    assert view is not None
    return view


def clear() -> None:
    """Forgets all tables."""
    for kept in (_tables, _baking, _shown):
        kept.clear()


def _forget(kept: dict) -> None:
    """Drops the oldest."""
    while len(kept) > KEPT:
        del kept[next(iter(kept))]


def _key(scene: bpy.types.Scene, size: int) -> tuple:
    """All that the table depends on. Exposure multiplies before it, except where there are curves."""
    return size, view_key(scene, with_exposure=scene.view_settings.use_curve_mapping)


def _slices(scene: bpy.types.Scene, size: int) -> Iterator[Table | None]:
    """The table after as many Nones as it takes."""
    learnt = (yield from false_color.learn(scene, LOG_MAX)) if false_color.applies(scene) else None
    if learnt is None:
        yield (yield from _colored(scene, size)), None
        return
    weights, levels = learnt
    formed_by = false_color.formed_by(scene)
    table = yield from _colored(scene, size, formed_by, lambda shown: false_color.brightness(shown, weights)[..., None])
    yield table, levels


def _colored(
    scene: bpy.types.Scene,
    size: int,
    view: dict[str, Any] | None = None,
    entries_of: Callable[[np.ndarray], np.ndarray] = lambda shown: shown,
) -> Generator[None, None, np.ndarray]:
    """The entries that the scene's view shows, or another (see `displayed`), or what follows from these."""
    axis = shaper_axis(size, LOG_MAX)

    def rows_of(rows: slice) -> np.ndarray:
        blue, green = np.divmod(np.arange(rows.start, rows.stop), size)
        colors = np.empty((len(blue), size, 3), np.float32)
        colors[..., 0], colors[..., 1], colors[..., 2] = axis, axis[green, None], axis[blue, None]
        # Exposure multiplies before the table is looked up, so Blender's own is taken out of the entries.
        settings = scene.view_settings
        return colors if view or settings.use_curve_mapping else colors / np.float32(2.0**settings.exposure)

    table = np.ones((size * size, size, 4), np.float32)  # [blue and green, red, channel]
    for rows, shown in displayed_in_slices(scene, size * size, size, rows_of, view):
        table[rows, :, :3] = entries_of(shown)
        yield None
    return table.reshape(size, size, size, 4)


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
