"""Strokes of the scribble brush: what the picture should do, and where.

Places are fractions of the picture, (0, 0) its top left corner and (1, 1) its bottom right one; a radius is a fraction
of the picture's height. A scene keeps its strokes as JSON with `"format": "relume-strokes"` and `"version": 1`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

FORMAT, VERSION = "relume-strokes", 1
BRIGHTER, DARKER, COLOR, WARMER, COOLER, SHADOW, KEEP = MEANINGS = (
    "brighter",
    "darker",
    "color",
    "warmer",
    "cooler",
    "shadow",
    "keep",
)
ERASE = "erase"
"""An eraser takes from all strokes that were painted before it."""
BRIGHTNESS, TINT = {BRIGHTER, DARKER, SHADOW, KEEP}, {COLOR, WARMER, COOLER, KEEP}
"""Meanings of which a place can have one."""
UNITS = {BRIGHTER: "stops", DARKER: "stops", SHADOW: "stops", WARMER: "mireds", COOLER: "mireds"}
"""Unit of each meaning's amount, which is also the amount's name in a request."""
SPACING = 0.2
"""Spacing of points along a stroke, in radii: a round brush hides closer ones."""
FARTHEST = 10.0
"""Largest distance of a place from the picture, in sizes of the picture."""
DIGITS = 5
"""A hundred thousandth of the picture."""


Point = tuple[float, float, float]


class StrokeError(Exception):
    """Strokes cannot be read; the message is one line for the artist."""


@dataclass(frozen=True)
class Meaning:
    """Goal for a place in the picture."""

    goal: str
    """One of MEANINGS, or ERASE."""
    amount: float = 0.0
    """Amount in the unit of the goal; 0 if the goal has none."""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Scene-linear; of the goal COLOR."""

    def plain(self) -> dict[str, Any]:
        """Goal of a request, without its place."""
        out: dict[str, Any] = {"goal": self.goal}
        if self.goal in UNITS:
            out[UNITS[self.goal]] = self.amount
        elif self.goal == COLOR:
            out["color"] = list(self.color)
        return out

    def replaces(self, other: Meaning) -> bool:
        """True if painting this removes strokes of the other meaning: erasing removes all, brighter removes darker but
        not warmer."""
        if self.goal == ERASE:
            return True
        return self != other and any({self.goal, other.goal} <= group for group in (BRIGHTNESS, TINT))


def meaning(goal: str, amount: float = 0.0, color: Iterable[float] = (1.0, 1.0, 1.0)) -> Meaning:
    """A meaning with only what its goal has, so that equal ones compare equal."""
    red, green, blue = (round(channel, DIGITS) for channel in color) if goal == COLOR else (1.0, 1.0, 1.0)
    return Meaning(goal, round(amount, DIGITS) if goal in UNITS else 0.0, (red, green, blue))


@dataclass(frozen=True)
class Stroke:
    """One movement of the brush."""

    meaning: Meaning
    radius: float
    strength: float
    """Weight of the stroke, 0 to 1."""
    points: tuple[Point, ...]
    """x, y and pressure (0 to 1, a factor on the radius)."""
    shot: str = ""
    """Key of the listed shot that it is painted in; empty where there is no list."""

    def region(self) -> dict[str, Any]:
        """Stroke of a request."""
        points = [list(point) for point in self.points]
        return {"radius": self.radius, "strength": self.strength, "erase": False, "points": points}


def thinned(movement: Iterable[Sequence[float]], radius: float, aspect: float) -> tuple[Point, ...]:
    """The points of a movement without those that its brush hides; the first and the last are kept. `aspect` is the
    picture's width by its height."""
    points = [(round(x, DIGITS), round(y, DIGITS), round(pressure, DIGITS)) for x, y, pressure in movement]
    kept = points[:1]
    for point in points[1:]:
        if math.hypot((point[0] - kept[-1][0]) * aspect, point[1] - kept[-1][1]) >= SPACING * radius:
            kept.append(point)
    if len(points) > 1 and kept[-1] != points[-1]:
        kept.append(points[-1])
    return tuple(kept)


def goals(strokes: Iterable[Stroke]) -> list[dict[str, Any]]:
    """The goals of a request: one for each meaning, in the order of their first strokes."""
    found: dict[Meaning, list[dict[str, Any]]] = {}
    for stroke in strokes:
        for meaning, regions in found.items():
            if stroke.meaning.replaces(meaning):
                regions.append(stroke.region() | {"erase": True})
        if stroke.meaning.goal != ERASE:
            found.setdefault(stroke.meaning, []).append(stroke.region())
    return [meaning.plain() | {"where": {"strokes": regions}} for meaning, regions in found.items()]


def to_json(strokes: Iterable[Stroke]) -> str:
    """The text of strokes."""
    plain = []
    for stroke in strokes:
        values = asdict(stroke)
        plain.append(values.pop("meaning") | values)
    return json.dumps({"format": FORMAT, "version": VERSION, "strokes": plain}, separators=(",", ":"))


def from_json(text: str) -> tuple[Stroke, ...]:
    """Reads strokes and checks all of them; no text is no strokes. Raises StrokeError."""
    if not text:
        return ()
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StrokeError(f"these are no strokes: not JSON ({error})") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise StrokeError(f'these are no strokes: their "format" is not "{FORMAT}"')
    if data.get("version") != VERSION:
        raise StrokeError(
            f"strokes of version {data.get('version')!r}; this Relume reads version {VERSION}: update Relume"
        )
    if not isinstance(data.get("strokes"), list):
        raise StrokeError('damaged strokes: no list "strokes"')
    return tuple(_stroke(entry, number) for number, entry in enumerate(data["strokes"], 1))


def _stroke(entry: Any, number: int) -> Stroke:
    def checked(key: str, is_good: Any) -> Any:
        value = entry.get(key) if isinstance(entry, dict) else None
        if not is_good(value):
            raise StrokeError(f'damaged strokes: stroke {number} has no usable "{key}" (found {str(value)[:40]})')
        return value

    goal = checked("goal", lambda value: value in {*MEANINGS, ERASE})
    amount = checked("amount", lambda value: _is_within(value, 0.0, 1e4))
    color = checked("color", lambda value: _is_list_of(value, 3, 0.0, 1e4))
    radius = checked("radius", lambda value: _is_within(value, 1e-4, 10.0))
    strength = checked("strength", lambda value: _is_within(value, 0.0, 1.0))
    points = checked("points", lambda value: isinstance(value, list) and value and all(map(_is_point, value)))
    shot = checked("shot", lambda value: value is None or isinstance(value, str)) or ""
    places = tuple((x, y, pressure) for x, y, pressure in points)
    return Stroke(meaning(goal, amount, color), radius, strength, places, shot)


def _is_point(value: Any) -> bool:
    return _is_list_of(value, 3, -FARTHEST, FARTHEST) and 0.0 <= value[2] <= 1.0


def _is_list_of(value: Any, size: int, low: float, high: float) -> bool:
    return isinstance(value, list) and len(value) == size and all(_is_within(number, low, high) for number in value)


def _is_within(value: Any, low: float, high: float) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and low <= value <= high
