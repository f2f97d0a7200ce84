"""Agreement of two renderers, judged by means of blocks and by the noise that two pictures of each show."""

import numpy as np

BLOCK = 8
LIMIT = 0.08
"""Limit of a block's difference, relative to its brighter value."""

ERRORS = 4.0
"""How many standard errors a difference must exceed."""

DARK, BLACK = 0.5, 1e-3
"""Share of the mean of its picture, and radiance, that are added to a block's value before it is compared. Darker
blocks are lit by rare paths, whose noise two pictures do not show."""


def block_means(image, fold=np.mean):
    """Means, or what else `fold` gives, of 8 x 8 pixels, channels kept: [height / 8, width / 8, 3]."""
    height, width = (size // BLOCK * BLOCK for size in image.shape[:2])
    return fold(image[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3), axis=(1, 3))


def standard_error(pair):
    """Standard error of the block means of the mean of two pictures, from their differences in single pixels; and at
    least the brightest pixel's share of a block: neither picture may hold the rare path that lights another one."""
    half = (np.asarray(pair[0], np.float64) - pair[1]) / 2
    rare = block_means(np.abs(np.mean(np.asarray(pair, np.float64), axis=0)), np.max) / BLOCK**2
    return np.maximum(np.sqrt(block_means(half * half)) / BLOCK, rare)


def worst_block(ours, cycles):
    """The block that differs most, or None where all agree; each side is a pair of pictures [height, width, 3] with
    independent noise. A block that Cycles leaves without finite values is not judged."""
    a, b = (block_means(np.mean(np.asarray(pair, np.float64), axis=0)) for pair in (ours, cycles))
    judged = np.isfinite(b)
    if (judged & ~np.isfinite(a)).any():
        return {"fault": "not finite"}
    a, b = np.where(judged, a, 0.0), np.where(judged, b, 0.0)
    error = np.nan_to_num(np.hypot(standard_error(ours), standard_error(cycles)))
    difference = np.abs(a - b)
    allowed = LIMIT * (np.maximum(np.abs(a), np.abs(b)) + DARK * np.abs(b).mean() + BLACK)
    excess = np.where(difference > ERRORS * error, difference / allowed, 0.0)
    if excess.max() <= 1.0:
        return None
    row, column, _ = np.unravel_index(np.argmax(excess), excess.shape)
    figures = {"ours": a, "cycles": b, "error": error}
    found = {name: [float(f"{value:.4g}") for value in figures[name][row, column]] for name in figures}
    return {"fault": "difference", "block": [int(row), int(column)], **found}


def region(image, render):
    """The part of a picture that a render region leaves, be the picture whole or cut to it already."""
    width, height = render.resolution_x, render.resolution_y
    if not render.use_border or image.shape[:2] != (height, width):
        return image
    left, right = round(render.border_min_x * width), round(render.border_max_x * width)
    low, high = round(render.border_min_y * height), round(render.border_max_y * height)
    return image[height - high : height - low, left:right]
