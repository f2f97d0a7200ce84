"""Rows once their common values are written into the lights: every shot keeps its picture."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from .rows import GROUP, LIGHT, STATIC, Row, mix, times

Mix = tuple[Iterable[Row], Iterable[Row], Mapping[str, Iterable[str]]]
"""Rows, groups and memberships, as `rows.mix` takes them."""


@dataclass(frozen=True)
class AppliedRows:
    """Rows, then groups, in the order in which they were given."""

    common: list[Row]
    """Values in all shots that have none of their own."""
    own: dict[str, list[Row]]
    """Values in other shots, by their keys."""
    kept: list[Row]
    """Rows whose common values must not be written: a light without red, or without anything, could not be given back
    to a shot that has some."""


def applied(common: Mix, shots: Mapping[str, Mix]) -> AppliedRows:
    """Rows after applying: neutral, and in shots with other values what these are beside the common ones. Groups are
    neutral everywhere; what they did is in the rows of their members."""
    rows, groups, memberships = common
    rows, base = list(rows), mix(rows, groups, memberships)
    theirs = {key: (list(found[0]), mix(*found)) for key, found in shots.items()}
    out = AppliedRows([], {key: [] for key in shots}, [])
    for place, row in enumerate(rows):
        if row.kind == STATIC:
            out.common.append(_unwritten(row, base))
            for key, (found, gains) in theirs.items():
                out.own[key].append(_unwritten(found[place], gains))
            continue
        before = _gain(row, base)
        after = {key: _gain(row, gains) for key, (_, gains) in theirs.items()}
        is_kept = any(old <= 0.0 < new for gain in after.values() for old, new in zip(before, gain, strict=True))
        if is_kept:
            out.kept.append(row)
        out.common.append(_with_gain(row, before) if is_kept else Row(row.name, row.kind))
        for key, gain in after.items():
            out.own[key].append(_with_gain(theirs[key][0][place], gain if is_kept else _ratio(gain, before)))
    for group in groups:
        for values in (out.common, *out.own.values()):
            values.append(Row(group.name, GROUP))
    return out


def _unwritten(row: Row, gains: Mapping[str, Any]) -> Row:
    """The row of what no light can hold."""
    return replace(row, solo=False, on=any(gains["static"]))


def _with_gain(row: Row, gain: list[float]) -> Row:
    """A row with a gain by itself, without groups: with its own values if these are that."""
    is_same = row.gain() == gain if row.on else not any(gain)
    return replace(row, solo=False) if is_same else times(Row(row.name, row.kind), gain)


def _gain(row: Row, gains: Mapping[str, Any]) -> list[float]:
    return gains["gains"][row.name] if row.kind == LIGHT else gains[row.kind.lower()]


def _ratio(gain: list[float], before: list[float]) -> list[float]:
    """Factor from one gain to another; 1 for channels that neither has."""
    return [new / old if old > 0.0 else 1.0 for new, old in zip(gain, before, strict=True)]
