"""Strokes painted by a script where a known change of the lights shows, and what became of the picture there.

Regions are found in block means of the picture, so that noise does not make them. A stroke runs through the middles of
blocks that lie side by side.
"""

import math

import numpy as np

BLOCK = 8
CHANGED = 0.2
"""Stops; what changes by less is not painted as brighter or darker."""
KEPT = 0.005
"""Relative; what the known change leaves within this may be painted as keep."""
ASKED_SHARE = 0.8
"""Of what the known change does on average along a stroke, so that the known answer meets what is asked."""
LUMINANCE = (0.2126, 0.7152, 0.0722)
LONGEST = 6
"""Blocks a stroke runs through."""


def luminance(picture):
    """Rec. 709."""
    return picture @ np.array(LUMINANCE, np.float32)


def blocks(values):
    """Means over whole blocks."""
    height, width = (size // BLOCK for size in values.shape)
    return values[: height * BLOCK, : width * BLOCK].reshape(height, BLOCK, width, BLOCK).mean(axis=(1, 3))


def paint(before, after, rng):
    """Goals for `relume.solve`: at most one stroke of each meaning, and the known change along each."""
    old, new = blocks(luminance(before)), blocks(luminance(after))
    bright_enough = old > 0.02 * old.mean()
    stops = np.where(bright_enough, np.log2(np.maximum(new, 1e-9) / np.maximum(old, 1e-9)), 0.0)
    steady = bright_enough & (np.abs(new / np.maximum(old, 1e-9) - 1.0) < KEPT)
    kinds = {
        "brighter": stops > max(CHANGED, 0.5 * stops.max()),
        "darker": stops < min(-CHANGED, 0.5 * stops.min()),
        "keep": steady,
    }
    goals = []
    for kind, where in kinds.items():
        if not where.any():
            continue
        where_painted = {"strokes": [stroke(where, before.shape, rng)]}
        known = change(before, after, where_painted)
        goal = {"goal": kind, "where": where_painted}
        if kind != "keep":
            goal["stops"] = round(ASKED_SHARE * abs(math.log2(known)), 3)
        goals.append((goal, known))
    return goals


def stroke(where, shape, rng):
    """A stroke through neighbouring blocks of a region, from a random one of those with most neighbours in it."""
    padded = np.pad(where, 1).astype(int)
    height, width = where.shape
    around = sum(padded[1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width] for dy in (-1, 0, 1) for dx in (-1, 0, 1))
    inner = np.argwhere(where & (around == np.where(where, around, 0).max()))
    path = [tuple(map(int, inner[rng.randrange(len(inner))]))]
    while len(path) < LONGEST:
        y, x = path[-1]
        steps = [(y + dy, x + dx) for dy, dx in ((0, 1), (1, 0), (0, -1), (-1, 0))]
        free = [(a, b) for a, b in steps if 0 <= a < height and 0 <= b < width and where[a, b] and (a, b) not in path]
        if not free:
            break
        path.append(rng.choice(free))
    rows, columns = shape[:2]
    points = [[(x + 0.5) * BLOCK / columns, (y + 0.5) * BLOCK / rows, 1.0] for y, x in path]
    return {"radius": 0.5 * BLOCK / rows, "strength": 1.0, "erase": False, "points": points}


def mask(region, shape):
    """Pixels within the strokes of a region, [height, width]."""
    rows, columns = shape[:2]
    y, x = np.mgrid[:rows, :columns] + 0.5
    inside = np.zeros((rows, columns), bool)
    for painted in region["strokes"]:
        corners = [np.array((across * columns, down * rows)) for across, down, _ in painted["points"]]
        for a, b in zip(corners, corners[1:] or corners, strict=False):
            along = b - a
            share = ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / max(along @ along, 1e-9)
            share = np.clip(share, 0.0, 1.0)
            distance = np.hypot(x - a[0] - share * along[0], y - a[1] - share * along[1])
            inside |= distance <= painted["radius"] * rows
    return inside


def change(before, after, region):
    """Ratio of the mean luminances within a region."""
    inside = mask(region, before.shape)
    return float(luminance(after)[inside].mean() / luminance(before)[inside].mean())
