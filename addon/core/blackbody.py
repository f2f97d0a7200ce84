"""Colour of a black body, as Blender's Blackbody node and its lights have it.

Blender fits each channel of linear Rec.709 piecewise in the temperature T: red and green as a / T + b T + c, blue as a
cubic. Constants: Cycles, `intern/cycles/kernel/svm/math_util.h`. Outside of the range the colour stays at its ends.
"""

from __future__ import annotations

from bisect import bisect_right

BOUNDS_K = (965.0, 1167.0, 1449.0, 1902.0, 3315.0, 6365.0)
"""Limits between the pieces."""

COLDEST_K, HOTTEST_K = 800.0, 12000.0
COLDEST, HOTTEST = [5.413294490189271, 0.0, 0.0], [0.8262954810464208, 0.9945080501520986, 1.566307710274283]

RED = (
    (1.61919106e03, -2.05010916e-03, 5.02995757),
    (2.48845471e03, -1.11330907e-03, 3.22621544),
    (3.34143193e03, -4.86551192e-04, 1.76486769),
    (4.09461742e03, -1.27446582e-04, 7.25731635e-01),
    (4.67028036e03, 2.91258199e-05, 1.26703442e-01),
    (4.59509185e03, 2.87495649e-05, 1.50345020e-01),
    (3.78717450e03, 9.35907826e-06, 3.99075871e-01),
)
GREEN = (
    (-4.88999748e02, 6.04330754e-04, -7.55807526e-02),
    (-7.55994277e02, 3.16730098e-04, 4.78306139e-01),
    (-1.02363977e03, 1.20223470e-04, 9.36662319e-01),
    (-1.26571316e03, 4.87340896e-06, 1.27054498),
    (-1.42529332e03, -4.01150431e-05, 1.43972784),
    (-1.17554822e03, -2.16378048e-05, 1.30408023),
    (-5.00799571e02, -4.59832026e-06, 1.09098763),
)
BLUE = (
    (5.96945309e-11, -4.85742887e-08, -9.70622247e-05, -4.07936148e-03),
    (2.40430366e-11, 5.55021075e-08, -1.98503712e-04, 2.89312858e-02),
    (-1.40949732e-11, 1.89878968e-07, -3.56632824e-04, 9.10767778e-02),
    (-3.61460868e-11, 2.84822009e-07, -4.93211319e-04, 1.56723440e-01),
    (-1.97075738e-11, 1.75359352e-07, -2.50542825e-04, -2.22783266e-02),
    (-1.61997957e-13, -1.64216008e-08, 3.86216271e-04, -7.38077418e-01),
    (6.72650283e-13, -2.73078809e-08, 4.24098264e-04, -7.52335691e-01),
)


def blackbody_color(kelvin: float) -> list[float]:
    """Linear Rec.709 of luminance about 1; its range is 800 to 12000 K."""
    return [max(0.0, value) for value in blackbody_fit(kelvin)]


def blackbody_fit(kelvin: float) -> list[float]:
    """Blackbody colour of Cycles' volumes, with blue a little below 0 where it is coldest."""
    if kelvin >= HOTTEST_K:
        return list(HOTTEST)
    if kelvin < COLDEST_K:
        return list(COLDEST)
    piece = bisect_right(BOUNDS_K, kelvin)
    a, b, c, d = BLUE[piece]
    red, green = (a / kelvin + b * kelvin + c for a, b, c in (RED[piece], GREEN[piece]))
    return [red, green, ((a * kelvin + b) * kelvin + c) * kelvin + d]
