"""Dispersion of glass: colours of the wavelengths that paths take through it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Color

from ...core.color_matching import D65, X, Y, Z
from .graph import Context
from .translation import Translation


def dispersion(t: Translation, node: bpy.types.Node, context: Context) -> dict[str, Any]:
    """The dispersion of a node as a field of the JSON form; none if it is off."""
    scale = t.value(node, "Transmission Dispersion Scale", context, 0.0)
    if scale == 0.0:
        return {}
    abbe_number = t.value(node, "Transmission Dispersion Abbe Number", context, 20.0)
    colors = [[float(channel) for channel in color] for color in _colors()]
    return {"dispersion": {"scale": scale, "abbe_number": abbe_number, "colors": colors}}


def _colors() -> np.ndarray:
    """Scene-linear colours of daylight's wavelengths, by steps from the first to the last, [N, 3]. Their mean is white.
    Pure colours are beyond every working space: what is below 0 is taken from the nearest wavelengths, since records
    of paths hold no light below 0."""
    matched = np.array([X, Y, Z]).T * np.array(D65)[:, None]
    linear = np.array([Color(color).from_xyz_d65_to_scene_linear() for color in matched.tolist()])
    steps = 0.5 * (linear[1:] + linear[:-1])
    shares = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]) / steps.sum(axis=0)
    rising = np.array([_rising(channel) for channel in shares.T.clip(0.0, 1.0)]).T
    return len(steps) * np.diff(rising, axis=0)


def _rising(values: np.ndarray) -> np.ndarray:
    """The nearest values that never fall, by pooling neighbours (Ayer et al. 1955)."""
    pools: list[tuple[float, int]] = []
    for value in values:
        pools.append((float(value), 1))
        while len(pools) > 1 and pools[-2][0] > pools[-1][0]:
            (mean, count), (other, others) = pools[-2:]
            pools[-2:] = [((mean * count + other * others) / (count + others), count + others)]
    return np.concatenate([np.full(count, mean) for mean, count in pools])
