"""The mix: a row of controls per light, group, world and static light, and the gains that they amount to.

A gain multiplies a light's radiance by channel. The rules:

* a row that is off is silent, and so is a group that is off, with all of its members;
* once anything is soloed, only soloed rows are heard, and the members of soloed groups; off wins over solo;
* a light's gain is its own times that of each group that it belongs to, directly or through a group inside another.
  A group counts once, however many ways lead to it; two collections with the same light multiply.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from math import isclose
from typing import Any

from .blackbody import blackbody_color

LIGHT, GROUP, WORLD, STATIC = "LIGHT", "GROUP", "WORLD", "STATIC"
DIALS = ("on", "exposure", "multiplier", "color", "use_kelvin", "kelvin")
"""Values that a row can have of its own in a single shot."""
NEUTRAL, SILENT = [1.0, 1.0, 1.0], [0.0, 0.0, 0.0]
ROUNDING = 1e-6


@dataclass(frozen=True)
class Row:
    """One line of the mix."""

    name: str
    """The light object's or the collection's; of world and static any."""
    kind: str = LIGHT
    on: bool = True
    solo: bool = False
    exposure: float = 0.0
    """Exposure in stops: one more doubles the light."""
    multiplier: float = 1.0
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Scene-linear tint."""
    use_kelvin: bool = False
    kelvin: float = 6500.0
    """Tint by the colour of a black body of this temperature, besides `color`."""

    def gain(self) -> list[float]:
        """Gain of this row's sliders, without on, off and solo."""
        strength = 2.0**self.exposure * self.multiplier
        tint = blackbody_color(self.kelvin) if self.use_kelvin else (1.0, 1.0, 1.0)
        return [strength * color * kelvin for color, kelvin in zip(self.color, tint, strict=True)]


def with_dials(row: Row, other: Row) -> Row:
    """The row with what another one has that can differ between shots."""
    return replace(row, **{name: getattr(other, name) for name in DIALS})


def bare_name(name: str) -> str:
    """The name of something in a library without the library, which Blender puts behind it: "Key [rig.blend]"."""
    bare, bracket, _ = name.rpartition(" [")
    return bare if bracket and name.endswith("]") else name


def is_neutral(row: Row) -> bool:
    """True if the row changes nothing, but for the rounding of 32 bits."""
    return row.on and not row.solo and all(isclose(gain, 1.0, rel_tol=ROUNDING) for gain in row.gain())


def any_solo(rows: Iterable[Row]) -> bool:
    """True if any row is soloed, so that only soloed rows are seen."""
    return any(row.solo for row in rows)


def mix(rows: Iterable[Row], groups: Iterable[Row], memberships: Mapping[str, Iterable[str]]) -> dict[str, Any]:
    """The gains of all lights by name, of the world and of static light.

    `memberships` lists, by the name of a light, all groups that it belongs to, also through other groups.
    """
    rows = list(rows)
    by_name = {group.name: group for group in groups}
    some_solo = any_solo([*rows, *by_name.values()])
    out: dict[str, Any] = {"gains": {}, "world": list(NEUTRAL), "static": list(NEUTRAL)}
    for row in rows:
        chain = _chain(row, by_name, memberships)
        gain = _product(chain) if _is_heard(chain, some_solo) else list(SILENT)
        if row.kind == LIGHT:
            out["gains"][row.name] = gain
        else:
            out[row.kind.lower()] = gain
    return out


def mix_for(
    lights: Iterable[str], rows: Iterable[Row], groups: Iterable[Row], memberships: Mapping[str, Iterable[str]]
) -> dict[str, Any]:
    """The mix by the names of lights in the native scene, where the second instance of 'Bulb' is 'Bulb#2'."""
    rows, groups = list(rows), list(groups)
    found = mix(rows, groups, memberships)
    gains = found["gains"]
    # Lights that are instanced in a way which `export.light_tree` does not know have no row.
    other = SILENT if any_solo([*rows, *groups]) else NEUTRAL
    by_light = {name: gains.get(name) or gains.get(name.rpartition("#")[0]) or other for name in lights}
    return found | {"gains": by_light}


def freed(
    rows: Iterable[Row], groups: Iterable[Row], memberships: Mapping[str, Iterable[str]], lights: Iterable[str]
) -> list[Row]:
    """Rows and groups of the same mix, in which nothing acts on some lights any more: their rows are neutral, so are
    groups that reach them; what these did is in the rows of their other members."""
    rows, by_name, lights = list(rows), {group.name: group for group in groups}, set(lights)
    if any_solo([*rows, *by_name.values()]):
        heard = [_is_heard(_chain(row, by_name, memberships), True) for row in rows]
        rows = [replace(row, on=row.on and is_heard, solo=False) for row, is_heard in zip(rows, heard, strict=True)]
        by_name = {name: replace(group, solo=False) for name, group in by_name.items()}
    reached = {name for light in lights for name in memberships.get(light, ()) if name in by_name}
    out = []
    for row in rows:
        folded = [group for group in _chain(row, by_name, memberships)[1:] if group.name in reached]
        out.append(Row(row.name) if row.kind == LIGHT and row.name in lights else _times(row, folded))
    return out + [Row(name, GROUP) if name in reached else group for name, group in by_name.items()]


def times(row: Row, gain: Iterable[float]) -> Row:
    """The row with a gain in its multiplier and colour."""
    gain = list(gain)
    strength = max(gain)
    if strength <= 0.0:
        return replace(row, on=False)
    red, green, blue = (channel * factor / strength for channel, factor in zip(row.color, gain, strict=True))
    return replace(row, multiplier=row.multiplier * strength, color=(red, green, blue))


def _times(row: Row, groups: list[Row]) -> Row:
    on = row.on and all(group.on for group in groups)
    gain = _product(groups)
    return replace(row if gain == NEUTRAL else times(row, gain), on=on)


def _chain(row: Row, groups: Mapping[str, Row], memberships: Mapping[str, Iterable[str]]) -> list[Row]:
    """A row and all groups that act on it."""
    names = dict.fromkeys(memberships.get(row.name, ())) if row.kind == LIGHT else {}
    return [row, *(groups[name] for name in names if name in groups)]


def _is_heard(chain: list[Row], some_solo: bool) -> bool:
    return all(row.on for row in chain) and (not some_solo or any_solo(chain))


def _product(chain: list[Row]) -> list[float]:
    out = list(NEUTRAL)
    for row in chain:
        out = [a * b for a, b in zip(out, row.gain(), strict=True)]
    return out
