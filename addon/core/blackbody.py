"""Colour of a black body, for Blenders that cannot be asked.

Planck's law against the CIE 1931 observer in the analytic form of Wyman, Sloan and Shirley, "Simple Analytic
Approximations to the CIE XYZ Color Matching Functions", JCGT 2(2), 2013, section 2.2.
"""

from __future__ import annotations

import math

PLANCK_C2_NM_K = 1.438776877e7

# Per channel: (weight, mean in nm, spread below and above the mean in 1/nm).
OBSERVER = (
    ((0.362, 442.0, 0.0624, 0.0374), (1.056, 599.8, 0.0264, 0.0323), (-0.065, 501.1, 0.0490, 0.0382)),
    ((0.821, 568.8, 0.0213, 0.0247), (0.286, 530.9, 0.0613, 0.0322)),
    ((1.217, 437.0, 0.0845, 0.0278), (0.681, 459.0, 0.0385, 0.0725)),
)

REC709_FROM_XYZ = (
    (3.2404542, -1.5371385, -0.4985314),
    (-0.9692660, 1.8760108, 0.0415560),
    (0.0556434, -0.2040259, 1.0572252),
)


def blackbody_color(kelvin: float) -> list[float]:
    """Linear Rec.709 of luminance 1, as Blender's Blackbody node; its range is 800 to 12000 K."""
    kelvin = min(max(kelvin, 800.0), 12000.0)
    xyz = [0.0, 0.0, 0.0]
    for wavelength_nm in range(380, 781, 2):
        radiance = wavelength_nm**-5.0 / math.expm1(PLANCK_C2_NM_K / (wavelength_nm * kelvin))
        for channel, lobes in enumerate(OBSERVER):
            xyz[channel] += radiance * sum(_lobe(wavelength_nm, *lobe) for lobe in lobes)
    return [max(0.0, sum(row[i] * xyz[i] for i in range(3)) / xyz[1]) for row in REC709_FROM_XYZ]


def _lobe(wavelength_nm: float, weight: float, mean_nm: float, below: float, above: float) -> float:
    scaled = (wavelength_nm - mean_nm) * (below if wavelength_nm < mean_nm else above)
    return weight * math.exp(-0.5 * scaled * scaled)
