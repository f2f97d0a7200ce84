"""Differences of two scene-linear pictures, [height, width, 3]; defined as in `relume_image::metrics`."""

from __future__ import annotations

import numpy as np

FULL_SCALE = 0.25
"""The difference, as displayed, that is white in the difference picture."""
RAMP = np.array(
    [[0.0, 0.0, 0.0], [0.05, 0.05, 0.6], [0.0, 0.5, 0.7], [0.1, 0.7, 0.1], [0.9, 0.8, 0.0], [0.9, 0.1, 0.0], [1, 1, 1]]
)
"""Colours from no difference to FULL_SCALE: black, blue, cyan, green, yellow, red, white."""


def exposure(reference: np.ndarray) -> float:
    """The factor that brings the mean of all values to 0.5; 1 for a black picture."""
    mean = float(reference.mean(dtype=np.float64))
    return 0.5 / mean if mean > 0.0 else 1.0


def tonemap(image: np.ndarray, factor: float) -> np.ndarray:
    """Reinhard's curve of the exposed picture; negative and NaN values become 0."""
    x = np.maximum(np.nan_to_num(image * factor, nan=0.0, posinf=1e30), 0.0)
    return x / (1.0 + x)


def psnr_reinhard(test: np.ndarray, reference: np.ndarray) -> float:
    """PSNR in dB of the tonemapped pictures; infinite if they are equal."""
    factor = exposure(reference)
    difference = tonemap(test, factor) - tonemap(reference, factor)
    error = float(np.mean(difference**2, dtype=np.float64))
    return -10.0 * float(np.log10(error)) if error > 0.0 else float("inf")


def relative_error(test: np.ndarray, reference: np.ndarray) -> float:
    """Mean of `|a - b|` over the mean of the reference; 0 for two black pictures."""
    error = float(np.mean(np.abs(test - reference), dtype=np.float64))
    mean = float(reference.mean(dtype=np.float64))
    return error / mean if mean > 0.0 else float(error > 0.0)


def false_color(test: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """The difference of the tonemapped pictures as colours of RAMP, the largest channel of each pixel."""
    factor = exposure(reference)
    difference = np.abs(tonemap(test, factor) - tonemap(reference, factor)).max(axis=-1)
    at = np.clip(difference / FULL_SCALE, 0.0, 1.0)
    stops = np.linspace(0.0, 1.0, len(RAMP))
    return np.stack([np.interp(at, stops, RAMP[:, channel]) for channel in range(3)], axis=-1).astype(np.float32)
