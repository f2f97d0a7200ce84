"""Buttons of the limits of lights."""

from __future__ import annotations

from .settings import LimitSettings

NUMBERS = {
    "limit_strength": ("darker", "brighter"),
    "limit_tint": ("tint",),
    "limit_turn": ("turn",),
    "limit_size": ("smallest", "largest"),
    "limit_sun": ("sun_least", "sun_most"),
    "limit_cone": ("cone_least", "cone_most"),
}
"""Switches of limits, and the values that they switch on."""
WITHOUT = {
    "box": {"SUN"},
    "limit_turn": {"POINT"},
    "limit_size": {"SUN"},
    "limit_sun": {"POINT", "SPOT", "AREA"},
    "limit_cone": {"POINT", "AREA", "SUN"},
}
"""Types of light that a limit does not concern."""


def draw(layout, settings: LimitSettings, kind: str | None = None) -> None:
    """Draws the limits for a type of light, or for all."""
    if kind not in WITHOUT["box"]:
        layout.prop(settings, "box")
    for switch, numbers in NUMBERS.items():
        if kind in WITHOUT.get(switch, ()):
            continue
        layout.prop(settings, switch)
        if getattr(settings, switch):
            line = layout.row(align=True)
            for number in numbers:
                line.prop(settings, number)
