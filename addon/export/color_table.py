"""The scene's view as a table for shaders, logarithmic in scene-linear red, green and blue.

Exposure multiplies before the table is looked up, so dragging it makes no table anew, unless the view has curves, which
Blender applies before exposure. Of a view that jumps from one colour to the next the table holds places in a list of
colours (`false_color`).
"""

from __future__ import annotations

import bpy
import numpy as np

from . import false_color
from .view_transform import displayed, shaper_axis

LOG_MAX = 10.0
"""Logarithm of the brightest value of the table. Filmic tells colours apart up to about 2^10."""
SIZE = 89
"""Entries along an axis: quarter stops, so that the clipping of "Standard" at 1.0 falls on an entry."""

Table = tuple[np.ndarray, np.ndarray | None]
"""Entries [blue, green, red, 4], spaced as `shaper_axis` up to LOG_MAX. A view with jumps has display colours [LEVELS,
3] too, of which the entries are the places, 0..1."""


def color_table(scene: bpy.types.Scene) -> Table:
    """The table of a scene's view."""
    size = SIZE
    axis = shaper_axis(size, LOG_MAX)
    cube = np.empty((size, size, size, 3), np.float32)
    cube[..., 0], cube[..., 1], cube[..., 2] = axis, axis[:, None], axis[:, None, None]
    colors = cube.reshape(size * size, size, 3)
    table = np.ones((size, size, size, 4), np.float32)
    learnt = false_color.learn(scene, LOG_MAX) if false_color.applies(scene) else None
    if learnt is not None:
        weights, levels = learnt
        shown = displayed(scene, colors, false_color.formed_by(scene))
        table[..., :3] = false_color.brightness(shown, weights).reshape(size, size, size, 1)
        return table, levels
    # Exposure multiplies before the table is looked up, so Blender's own is taken out of the entries.
    settings = scene.view_settings
    exposure = 0.0 if settings.use_curve_mapping else settings.exposure
    table[..., :3] = displayed(scene, colors / np.float32(2.0**exposure)).reshape(size, size, size, 3)
    return table, None
