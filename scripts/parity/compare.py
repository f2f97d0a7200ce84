"""The parity measure: relative difference of block means."""

import numpy as np

BLOCK = 8


def block_means(image):
    """Means over whole 8x8-pixel blocks and channels kept: (height/8, width/8, 3)."""
    height, width = (size // BLOCK * BLOCK for size in image.shape[:2])
    blocks = image[:height, :width].reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK, 3)
    return blocks.mean(axis=(1, 3))


def block_difference(a, b):
    """|a - b| / (max(a, b) + 0.01 mean) for every block and channel."""
    a, b = block_means(a), block_means(b)
    return np.abs(a - b) / (np.maximum(a, b) + 0.01 * 0.5 * (a.mean() + b.mean()))


def summary(a, b):
    """Median and 95th percentile of the block difference, and the ratio of the means."""
    difference = block_difference(a, b)
    return {
        "median": float(np.median(difference)),
        "p95": float(np.percentile(difference, 95)),
        "mean_ratio": float(a.mean() / b.mean()),
    }
