"""Strokes painted by a script where a known change of the lights shows, and what became of the picture there.

Regions are found in block means of the picture, so that noise does not make them. A stroke runs through the middles of
blocks that lie side by side.
"""

import numpy as np

BLOCK = 8
CHANGED = {"brighter": 0.2, "darker": 0.2, "shadow": 0.2, "warmer": 15.0, "cooler": 15.0, "color": 0.2}
"""Stops, mireds and distances of colour ratios; what changes by less is not painted."""
UNITS = {"brighter": "stops", "darker": "stops", "shadow": "stops", "warmer": "mireds", "cooler": "mireds"}
"""Units of goals that are asked for by amount."""
KEPT = 0.01
"""Relative, of all channels; what the known change leaves within this may be painted as keep."""
ASKED_SHARE = 0.8
"""Share of the known change's mean along a stroke that is asked for, so that the known answer meets it."""
LUMINANCE = (0.2126, 0.7152, 0.0722)
RATIO_PER_MIRED = 0.00769
"""Change of ln(red / blue) per mired, as the solver counts it (`rust/optimise/src/goal.rs`)."""
LONGEST = 6
"""Blocks a stroke runs through."""


def luminance(picture):
    """Rec. 709."""
    return picture @ np.array(LUMINANCE, np.float32)


def blocks(picture):
    """Means over whole blocks."""
    height, width = (size // BLOCK for size in picture.shape[:2])
    whole = picture[: height * BLOCK, : width * BLOCK]
    return whole.reshape(height, BLOCK, width, BLOCK, 3).mean(axis=(1, 3))


def chroma(color):
    """Colour ratios [..., 3], which brightness does not change."""
    return color / luminance(color)[..., None]


def done(kind, before, after):
    """Change of colours [..., 3] in the unit of a goal: stops or mireds as asked for, by how much colour ratios
    changed, or the share that changed of what is kept."""
    before, after = np.maximum(before, 1e-9), np.maximum(after, 1e-9)
    if kind == "color":
        return np.linalg.norm(chroma(after) - chroma(before), axis=-1)
    if kind == "keep":
        return np.abs(after - before).sum(axis=-1) / before.sum(axis=-1)
    if UNITS[kind] == "stops":
        stops = np.log2(luminance(after) / luminance(before))
        return stops if kind == "brighter" else -stops
    warmth = np.log(after[..., 0] / after[..., 2]) - np.log(before[..., 0] / before[..., 2])
    return (warmth if kind == "warmer" else -warmth) / RATIO_PER_MIRED


def paint(before, after, kinds, rng):
    """Goals for `relume.solve`: at most one stroke of each kind, and what the known change does along each."""
    old, new = blocks(before), blocks(after)
    bright_enough = luminance(old) > 0.02 * luminance(old).mean()
    goals = []
    for kind in kinds:
        change = np.where(bright_enough, done(kind, old, new), np.inf if kind == "keep" else 0.0)
        where = change < KEPT if kind == "keep" else change > max(CHANGED[kind], 0.5 * change.max())
        if not where.any():
            continue
        place = {"strokes": [stroke(where, before.shape, rng)]}
        goal = {"goal": kind, "where": place}
        if kind == "color":
            goal["color"] = mean_within(after, place).tolist()
        known = done_to(goal, before, after)
        if kind in UNITS:
            goal[UNITS[kind]] = round(ASKED_SHARE * known, 3)
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


def mean_within(picture, region):
    """Mean colour within a region."""
    return picture[mask(region, picture.shape)].mean(axis=0)


def asked(goal):
    """Least value of `done_to`, or its upper limit where a goal is to keep."""
    kind = goal["goal"]
    return goal[UNITS[kind]] if kind in UNITS else {"keep": 0.0, "color": ASKED_SHARE}[kind]


def done_to(goal, before, after):
    """`done` to the mean colour where a goal is; of a colour that was asked for, the share of the way to it."""
    old, new = (mean_within(picture, goal["where"]) for picture in (before, after))
    if goal["goal"] == "color":
        wanted = np.array(goal["color"])
        return float(1.0 - done("color", wanted, new) / done("color", wanted, old))
    return float(done(goal["goal"], old, new))
