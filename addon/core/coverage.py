"""Coverage of strokes in pixels: for drawing them, and for knowing whether anything of them is left."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from .strokes import BRIGHTER, COLOR, COOLER, DARKER, ERASE, KEEP, SHADOW, WARMER, Meaning, Stroke

COLORS = {
    BRIGHTER: (1.0, 0.85, 0.2),
    DARKER: (0.15, 0.2, 0.55),
    WARMER: (1.0, 0.45, 0.1),
    COOLER: (0.3, 0.7, 1.0),
    SHADOW: (0.35, 0.05, 0.5),
    KEEP: (0.2, 0.8, 0.35),
}
"""Display colours of what strokes mean; COLOR is drawn in its own."""
OPACITY = 0.6
EDGE = 0.3
"""Share of the radius over which a stroke fades at its rim. The formula is that of `relume_optimise::Region`."""
STROKES_KEPT = 256


def layers(strokes: Iterable[Stroke], size: tuple[int, int]) -> dict[Meaning, np.ndarray]:
    """Share of each pixel that each meaning covers, in a picture of width and height `size`: [height, width] from 0 to
    1, top row first."""
    width, height = size
    found: dict[Meaning, np.ndarray] = {}
    for stroke in strokes:
        box, cover = _cover(stroke, size)
        for meaning, layer in found.items():
            if stroke.meaning.replaces(meaning):
                layer[box] = np.minimum(layer[box], 1.0 - cover)
        if stroke.meaning.goal != ERASE:
            layer = found.setdefault(stroke.meaning, np.zeros((height, width), np.float32))
            layer[box] = np.maximum(layer[box], cover)
    return found


def painted(strokes: Iterable[Stroke], size: tuple[int, int]) -> np.ndarray:
    """The strokes as a picture to lay over: [height, width, 4], display colours premultiplied by alpha, top row first;
    later meanings cover earlier ones."""
    out: np.ndarray = np.zeros((size[1], size[0], 4), np.float32)
    for meaning, layer in layers(strokes, size).items():
        color = np.array([*display_color(meaning), 1.0], np.float32)
        alpha = (OPACITY * layer)[..., None]
        out = alpha * color + (1.0 - alpha) * out
    return out


def display_color(meaning: Meaning) -> tuple[float, ...]:
    """The colour that a meaning is drawn in."""
    if meaning.goal != COLOR:
        return COLORS[meaning.goal]
    brightest = max(*meaning.color, 1.0)
    return tuple((channel / brightest) ** (1.0 / 2.2) for channel in meaning.color)


@lru_cache(maxsize=STROKES_KEPT)
def _cover(stroke: Stroke, size: tuple[int, int]) -> tuple[tuple[slice, slice], np.ndarray]:
    """The box of pixels that a stroke touches, and how much it covers of them: the union of capsules between its
    points."""
    width, height = size
    points = np.array(stroke.points, np.float64)
    points[:, :2] *= (width, height)
    points[:, 2] *= stroke.radius * height
    reach = points[:, 2:].max() * (1.0 + EDGE) + 1.0
    low = np.clip(np.floor(points[:, :2].min(axis=0) - reach), 0, size).astype(int)
    high = np.clip(np.ceil(points[:, :2].max(axis=0) + reach), 0, size).astype(int)
    cover = np.zeros((max(high[1] - low[1], 0), max(high[0] - low[0], 0)), np.float32)
    for start, end in itertools.pairwise(points if len(points) > 1 else np.repeat(points, 2, axis=0)):
        _add_capsule(cover, low, start, end)
    return (slice(low[1], low[1] + cover.shape[0]), slice(low[0], low[0] + cover.shape[1])), stroke.strength * cover


def _add_capsule(cover: np.ndarray, corner: np.ndarray, start: np.ndarray, end: np.ndarray) -> None:
    """Adds the area between two circles, each given by x, y and radius in pixels."""
    reach = max(start[2], end[2]) * (1.0 + EDGE) + 1.0
    low = np.maximum(np.floor(np.minimum(start, end)[:2] - reach).astype(int) - corner, 0)
    high = np.minimum(np.ceil(np.maximum(start, end)[:2] + reach).astype(int) - corner, cover.shape[::-1])
    if (high <= low).any():
        return
    x = np.arange(low[0], high[0]) + 0.5 + corner[0] - start[0]
    y = (np.arange(low[1], high[1]) + 0.5 + corner[1] - start[1])[:, None]
    step = (end - start)[:2]
    along = np.clip((x * step[0] + y * step[1]) / max(step @ step, 1e-12), 0.0, 1.0)
    distance = np.hypot(x - along * step[0], y - along * step[1])
    radius = np.maximum(start[2] + along * (end[2] - start[2]), 1e-6)
    part = cover[low[1] : high[1], low[0] : high[0]]
    np.maximum(part, np.clip((radius - distance) / np.maximum(EDGE * radius, 0.5) + 0.5, 0.0, 1.0), out=part)
