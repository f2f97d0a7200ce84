"""Requests to the solver, and the meaning of its results for Blender's lights; as plain data."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from .rows import LIGHT, Row, freed, times
from .rows import WORLD as WORLD_ROW

COLORFUL = {"color", "warmer", "cooler", "target"}
"""Goals that ask for another colour. Without one, colours stay: else a light would be tinted green to be brighter,
since the eye sees green best."""
WORLD = "world"
"""Stands for the world among what is free."""
PARAMETERS = ("position", "direction", "size", "cone", "color", "strength")
"""Parameters of a light that can be locked, named as in a request."""
LACKING: dict[str, set[str]] = {
    "POINT": {"direction", "cone"},
    "SPOT": set(),
    "AREA": {"cone"},
    "SUN": {"position", "cone"},
}
"""Parameters that a type of light lacks."""
EFFORTS = {"QUICK": (2, 150), "NORMAL": (4, 300), "THOROUGH": (12, 600)}
"""Starts and steps of each effort."""
SETTINGS = {
    "energy": "energy",
    "color": "color",
    "radius": "shadow_soft_size",
    "use_soft_falloff": "use_soft_falloff",
    "angle": "angle",
    "shape": "shape",
    "size": "size",
    "size_y": "size_y",
    "spread": "spread",
    "spot_size": "spot_size",
    "spot_blend": "spot_blend",
}
"""Names of the solver's answer, and those of Blender's light. It leaves exposure, temperature, nodes and normalisation
as they are."""
NOTHING = 1e-3
"""Share of the strongest channel that counts as none."""
ROUNDING = 1e-4
"""Difference, absolute or relative, up to which a number of a light counts as unchanged in a result."""
LEAST_TOWARDS = 64
SHARE_TOWARDS = 4
"""One in so many of a bake's paths is traced once more to look for lights where a solver has put them."""


def parameters_of(kind: str) -> list[str]:
    """Parameters that a type of light has."""
    return [parameter for parameter in PARAMETERS if parameter not in LACKING[kind]]


class SolveError(Exception):
    """Nothing can be solved; the message is one line for the artist."""


def samples_towards(baked: int) -> int:
    """Paths per pixel that look for lights where a solver has put them. They alone say then how well these serve, so
    that they may not be much noisier than the bake."""
    return min(baked, max(LEAST_TOWARDS, baked // SHARE_TOWARDS))


@dataclass(frozen=True)
class Limits:
    """Limits on how far lights may go from their present state; None for no limit."""

    box: tuple[Sequence[float], Sequence[float]] | None = None
    """Lower and upper corner, metres, of where they may be; None for what the camera sees."""
    stops: tuple[float, float] | None = None
    """Least and most strength, above what it is."""
    tint: float | None = None
    """Stops by which the ratio of two channels of their colour may change."""
    degrees: float | None = None
    """Degrees by which they may turn."""
    size: tuple[float, float] | None = None
    """Least and most radius or edge, metres."""
    sun: tuple[float, float] | None = None
    """Least and most angle of suns from the middle to the edge, radians."""
    cone: tuple[float, float] | None = None
    """Bounds of the cone angle of spots."""
    stay: float | None = None
    """Weight that keeps them at their present state."""

    def bounds(self) -> dict[str, Any]:
        """Limits in the form of a request."""
        low, high = self.box or ((), ())
        found = {"min": list(low), "max": list(high), "tint": self.tint, "degrees": self.degrees}
        found |= {name: list(getattr(self, name) or ()) for name in ("stops", "size", "sun", "cone")}
        return {name: value for name, value in found.items() if value not in ([], None)}

    def own(self) -> dict[str, Any]:
        """Limits in the form of a request, for one light."""
        bounds = self.bounds()
        return ({"bounds": bounds} if bounds else {}) | ({} if self.stay is None else {"stay": self.stay})


@dataclass(frozen=True)
class SolveOptions:
    """Settings of a solve."""

    free: dict[str, list[str]]
    """Parameters that may change, by the name of a light, or WORLD."""
    goals: list[dict[str, Any]]
    """Goals of a request."""
    keep_rest: float = 0.01
    limits: Limits = Limits()
    per_light: dict[str, Limits] = field(default_factory=dict)
    """Limits of single lights that differ, by name."""
    add_count: int = 0
    add_type: str = "point"
    remove: bool = False
    starts: int = 4
    steps: int = 300


def request(shown: dict[str, Any], options: SolveOptions) -> dict[str, Any]:
    """The solver's request; `shown` is the picture: "lights", "gains", "world", "static". Raises SolveError."""
    if not options.goals:
        raise SolveError("Say what the picture should do first: paint a stroke, add a region, or choose a target")
    keeps = set() if COLORFUL & {goal["goal"] for goal in options.goals} else {"color"}
    free = {name: [move for move in moves if move not in keeps] for name, moves in options.free.items()}
    colored = {name for name, moves in free.items() if "color" in moves}
    if not any(free.values()) and not options.add_count:
        raise SolveError("Nothing may change: unlock something of a light, or allow new lights")
    out = {
        **{name: shown[name] for name in ("gains", "world", "static")},
        "lights": [_tinted(light) if light["name"] in colored else light for light in shown["lights"]],
        "free": {name: moves for name, moves in free.items() if moves},
        "goals": options.goals,
        "keep_rest": options.keep_rest,
        "stay": options.limits.stay or 0.0,
        "remove": options.remove,
        "starts": options.starts,
        "steps": options.steps,
    }
    each = {name: limits.own() for name, limits in options.per_light.items() if name in out["free"] and limits.own()}
    out |= {name: value for name, value in (("bounds", options.limits.bounds()), ("each", each)) if value}
    return out | ({"add": {"count": options.add_count, "type": options.add_type}} if options.add_count else {})


def _lacks_color(light: dict[str, Any]) -> bool:
    """True if a light's temperature gives none of a channel, such as blue at a candle's: no colour could bring it
    back."""
    return min(light.get("temperature_color", (1.0,))) <= 0.0


def _tinted(light: dict[str, Any]) -> dict[str, Any]:
    """A light with a temperature that lacks a channel as one of that colour, which any other can take the place of."""
    if not _lacks_color(light):
        return light
    tint = light["temperature_color"]
    color = [channel * factor for channel, factor in zip(light["color"], tint, strict=True)]
    return light | {"color": color, "temperature_color": [1.0, 1.0, 1.0]}


def _untinted(color: list[float], light: dict[str, Any]) -> dict[str, Any]:
    """Settings that give a tinted light a colour: under its temperature if that can be, else without."""
    tint = light["temperature_color"]
    if any(factor <= 0.0 and channel > NOTHING * max(color) for channel, factor in zip(color, tint, strict=True)):
        return {"color": color, "use_temperature": False}
    under = [channel / factor if factor > 0.0 else 1.0 for channel, factor in zip(color, tint, strict=True)]
    return {"color": under}


def moved_out_of_sight(answer: dict[str, Any], asked: Iterable[dict[str, Any]]) -> list[str]:
    """The lights of an answer that few paths meet where it has put them, by their names. Those that have the place and
    shape that they had in the request, `asked`, are met as often as before: paths that look for them would tell nothing
    of what was solved."""
    before = {light["name"]: light for light in asked}
    now = {light["name"]: light for light in answer["blender"]}

    def stays(name: str) -> bool:
        return name in before and name in now and _is_where_it_was(now[name], before[name])

    return [name for name in answer["rarely_met"] if not stays(name)]


def _is_where_it_was(now: dict[str, Any], before: dict[str, Any]) -> bool:
    """True if a light of a result has the place and shape of a request's light."""
    if "kind" not in before:  # As programs may write lights.
        return False
    rows = [zip(*pair, strict=True) for pair in zip(now["world_from_object"], before["world_from_object"], strict=True)]
    shape = [(now[name], value) for name, value in before["kind"].items() if name in now]
    return all(_is_close(*pair) for pair in itertools.chain(shape, *rows))


def _is_close(a: Any, b: Any) -> bool:
    return a == b or (not isinstance(a, str) and math.isclose(a, b, rel_tol=ROUNDING, abs_tol=ROUNDING))


@dataclass
class Solved:
    """The lights of a look that the solver's answer makes."""

    states: list[dict[str, Any]] = field(default_factory=list)
    """States as in `looks.Look.lights`, of lights that changed, are new, or are to be hidden."""
    gone: list[str] = field(default_factory=list)
    """Lights that are no longer in the scene."""


def solved(
    answer: dict[str, Any],
    present: dict[str, dict[str, Any]],
    shown: Iterable[dict[str, Any]] = (),
    asked: Iterable[dict[str, Any]] = (),
    taken: Iterable[str] = (),
) -> Solved:
    """Changes to the scene's lights that a result asks for, by name. `shown` are the lights of the picture, `asked`
    those of the request. New lights get names that are not `taken`."""
    out, taken = Solved(), set(taken)
    tinted = {light["name"]: light for light, other in zip(shown, asked, strict=True) if light != other}
    changed = set(answer["changed"])
    for found in answer["blender"]:
        name = found["name"]
        values = {SETTINGS[key]: value for key, value in found.items() if key in SETTINGS}
        matrix = [list(row) for row in found["world_from_object"]]
        if name in changed:
            if name not in present:
                out.gone.append(name)
                continue
            before = present[name]
            if name in tinted and "color" in values:
                values |= _untinted(values["color"], tinted[name])
            settings = {key: value for key, value in values.items() if key in before["settings"]}
            out.states.append(before | {"matrix": matrix, "settings": before["settings"] | settings})
        else:
            name = _free_name(name, taken)
            taken.add(name)
            state = {"name": name, "type": found["type"], "matrix": matrix, "hidden": False, "settings": values}
            out.states.append(state | {"added": True})
    for name in answer["removed"]:
        if name in present:
            out.states.append(present[name] | {"hidden": True})
        else:
            out.gone.append(name)
    return out


def _free_name(name: str, taken: set[str]) -> str:
    numbers = (f"{name}.{number:03}" for number in range(1, len(taken) + 2))
    return name if name not in taken else next(found for found in numbers if found not in taken)


def solved_rows(
    mix: tuple[Iterable[Row], Iterable[Row], dict[str, list[str]]], lights: Iterable[str], world: Iterable[float] | None
) -> list[Row]:
    """Rows of a look with solved lights. These lights hold their gains themselves, all others keep theirs; `mix` has
    rows, groups and memberships. `world` is the gain of the world's row; None if it has not changed."""
    rows, groups, memberships = mix
    names = set(lights)
    out = freed(rows, groups, memberships, names)
    known = {row.name for row in out if row.kind == LIGHT}
    out += [Row(name) for name in names - known]
    if world is None:
        return out
    gain = list(world)
    return [times(Row(row.name, WORLD_ROW), gain) if row.kind == WORLD_ROW else row for row in out]


def picture_request(answer: dict[str, Any], static: list[float]) -> dict[str, Any]:
    """Asks for the picture of an answer, whose lights hold their gains."""
    return {"lights": answer["lights"], "gains": {}, "world": answer["world"], "static": static, "with": "auto"}
