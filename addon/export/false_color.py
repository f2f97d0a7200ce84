"""The view "False Color" jumps from colour to colour with the brightness of a pixel, which no table of colours follows.
Brightness itself is smooth: a table holds that, and a list the colour of each brightness.

Blender's `config.ocio` forms the brightness from AgX for Rec.2020, made linear and weighted, and looks the root 2.5 of
it up in 4096 colours."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .view_transform import SHAPER_MIN, displayed

Weights = tuple[float, float, float]

NAME = "False Color"
FORMED_BY = {
    "display_device": "Rec.2020",
    "view_transform": "AgX",
    "look": "None",
    "exposure": 0.0,
    "gamma": 1.0,
    "use_curve_mapping": False,
}
REC2020_GAMMA, ROOT = 2.4, 2.5
WEIGHTS = ((0.2589235, 0.6104985, 0.1305779), (0.2658180, 0.5984699, 0.1357121))
"""Luminance weights of red, green and blue, in the configurations of Blender 5 and 4."""
LEVELS = 4096
ROWS, COLUMNS = 9, 1024
"""Size of the image of colours from which the list is learned: greys, and trials in the last row."""
GOOD = 0.5 / 255.0
"""Mean error of trials up to which the list is used: other configurations may form the view in another way."""


def applies(scene: bpy.types.Scene) -> bool:
    """True if a scene's view is False Colour alone."""
    view = scene.view_settings
    return view.view_transform == NAME and view.look == "None" and not view.use_curve_mapping


def formed_by(scene: bpy.types.Scene) -> dict[str, Any]:
    """The view that brightness is formed from, for `displayed`."""
    view = scene.view_settings
    balance = ("use_white_balance", "white_balance_temperature", "white_balance_tint")
    return FORMED_BY | {name: getattr(view, name) for name in balance if hasattr(view, name)}


def brightness(shown: np.ndarray, weights: Weights) -> np.ndarray:
    """Place in the list, 0..1, of colours [..., 3] that `formed_by` shows."""
    return np.maximum(shown.astype(np.float64) ** REC2020_GAMMA @ np.array(weights), 0.0) ** (1.0 / ROOT)


def learn(scene: bpy.types.Scene, log_max: float) -> tuple[Weights, np.ndarray] | None:
    """Weights and list, [LEVELS, 3]; None where they do not give the view."""
    colors = np.empty((ROWS, COLUMNS, 3), np.float32)
    colors[:-1] = np.exp2(np.linspace(SHAPER_MIN, log_max, (ROWS - 1) * COLUMNS)).reshape(ROWS - 1, COLUMNS, 1)
    colors[-1] = np.exp2(np.random.default_rng(1).uniform(-8.0, 4.0, (COLUMNS, 3)))
    shown = displayed(scene, colors / np.float32(2.0**scene.view_settings.exposure))
    formed = displayed(scene, colors, formed_by(scene))
    trials = [_list_of(shown, formed, weights) for weights in WEIGHTS]
    error, weights, levels = min(trials, key=lambda trial: trial[0])
    return (weights, levels) if error <= GOOD else None


def _list_of(shown: np.ndarray, formed: np.ndarray, weights: Weights) -> tuple[float, Weights, np.ndarray]:
    """Mean error of the trials, the weights, and the list that greys give with them."""
    places = brightness(formed, weights)
    greys, places_of_greys = shown[:-1].reshape(-1, 3), np.maximum.accumulate(places[:-1].ravel())
    entries = np.linspace(0.0, 1.0, LEVELS)
    nearest = np.searchsorted((places_of_greys[1:] + places_of_greys[:-1]) / 2.0, entries)
    levels = greys[nearest]
    return float(np.abs(look_up(levels, places[-1]) - shown[-1]).mean()), weights, levels


def look_up(levels: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The colours of the list at places of 0..1."""
    return levels[np.rint(np.clip(places, 0.0, 1.0) * (len(levels) - 1)).astype(int)]
