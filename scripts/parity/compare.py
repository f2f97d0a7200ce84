"""The parity measure: relative difference of block means, and whether noise explains it."""

import numpy as np

BLOCK = 8
ERRORS, SYSTEMATIC = 3.0, 0.005
"""Standard errors, and share of the value, that a block may differ by where noise is larger than the limits."""


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


def standard_error(pair):
    """Standard errors of the block means of the mean of two independent pictures, from their differences in single
    pixels."""
    half = 0.5 * (pair[0].astype(np.float64) - pair[1])
    return np.sqrt(block_means(half * half)) / BLOCK


def share_beyond_noise(ours, cycles):
    """Share of the blocks and channels that differ by more than three standard errors and 0.5 %; each side is a pair of
    independent pictures."""
    a, b = block_means(np.mean(ours, axis=0)), block_means(np.mean(cycles, axis=0))
    error = np.hypot(standard_error(ours), standard_error(cycles))
    return float((np.abs(a - b) > ERRORS * error + SYSTEMATIC * np.maximum(a, b)).mean())
