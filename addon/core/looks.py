"""Looks: all values of the mix and the lights as they were, as plain JSON that also serves other files.

A look is a JSON object with `"format": "relume-look"` and `"version": 1`. Rows, groups and lights are matched by
name, so it can be used with every camera and file whose lights have the same names. With values of single shots, which
are matched by name too, it is of version 2.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from .rows import GROUP, LIGHT, STATIC, WORLD, Row, bare_name, with_dials

FORMAT, VERSION, WITH_SHOTS = "relume-look", 1, 2
KINDS = (LIGHT, GROUP, WORLD, STATIC)


class LookError(Exception):
    """A look cannot be read; the message is one line for the artist."""


@dataclass(frozen=True)
class Look:
    """A named state of the mix and of the lights."""

    name: str
    rows: tuple[Row, ...] = ()
    """Rows of lights, groups, world and static light."""
    lights: tuple[dict[str, Any], ...] = ()
    """Each `{"name", "type", "matrix", "hidden", "settings"}`: `matrix` is world-from-object by rows, `settings`
    maps properties of the Blender light to values. One with `"added": true` is made where there is none of its name."""
    shots: dict[str, tuple[Row, ...]] = field(default_factory=dict)
    """Rows that have values of their own in a shot, by its name."""


@dataclass(frozen=True)
class Match:
    """Outcome of matching a look with the rows of a scene."""

    rows: list[Row] = field(default_factory=list)
    """New values of the scene's rows, in their order."""
    missing: list[str] = field(default_factory=list)
    """Lights and groups of the look that the scene does not have."""
    unknown: list[str] = field(default_factory=list)
    """Lights of the scene that the look does not know: switched off, as they were not in its picture."""


def match(look: Look, present: Iterable[Row]) -> Match:
    """The scene's rows with the values of the look. Groups, world and static light that it does not know become
    neutral. Raises LookError if it has no light of this scene."""
    present = list(present)
    found, left = _matched(look.rows, present)
    lights = [place for place, row in enumerate(present) if row.kind == LIGHT]
    unknown = [present[place].name for place in lights if found[place] is None]
    if lights and len(unknown) == len(lights):
        raise LookError(f"look '{look.name}' has none of this scene's lights; lights are matched by name")
    rows = [was or Row(row.name, row.kind, on=row.kind != LIGHT) for was, row in zip(found, present, strict=True)]
    missing = [row.name for row in left if row.kind in {LIGHT, GROUP}]
    return Match(rows, missing, unknown)


def own_rows(look: Look, shot: str, present: Iterable[Row]) -> list[Row | None]:
    """Values of their own that a look has for the scene's rows in a shot of that name; None for the others."""
    return _matched(look.shots.get(shot, ()), list(present))[0]


def rows_in(look: Look, shot: str, present: Iterable[Row]) -> list[Row]:
    """The scene's rows with the values that a look has in a shot of that name. Raises LookError as `match`."""
    present = list(present)
    common, own = match(look, present).rows, own_rows(look, shot, present)
    return [row if found is None else with_dials(row, found) for row, found in zip(common, own, strict=True)]


def _matched(rows: Iterable[Row], present: list[Row]) -> tuple[list[Row | None], list[Row]]:
    """The row for each present one, if there is one, and those that are left."""
    known = {_key(row): row for row in rows}
    found = [known.pop(_key(row), None) for row in present]
    # Linked here and not where the look was made, or the other way round.
    bare = {_key(replace(row, name=bare_name(row.name))): key for key, row in known.items()}
    for place, row in enumerate(present):
        if found[place] is None:
            key = bare.pop(_key(replace(row, name=bare_name(row.name))), None)
            found[place] = known.pop(key) if key else None
    return found, list(known.values())


def _key(row: Row) -> tuple[str, str]:
    return (row.kind, row.name if row.kind in {LIGHT, GROUP} else "")


def to_json(look: Look) -> str:
    """The text of a look."""
    values = asdict(look)
    if not look.shots:
        del values["shots"]
    version = WITH_SHOTS if look.shots else VERSION
    return json.dumps({"format": FORMAT, "version": version, **values}, indent=1, ensure_ascii=False)


def from_json(text: str | bytes) -> Look:
    """Reads a look and checks all of it. Raises LookError."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LookError(f"this is not a look: it is not JSON ({error})") from error
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise LookError(f'this is not a look: its "format" is not "{FORMAT}"')
    if data.get("version") not in (VERSION, WITH_SHOTS):
        known = f"versions {VERSION} and {WITH_SHOTS}"
        raise LookError(f"look of version {data.get('version')!r}; this Relume reads {known}: update Relume")
    name = _checked(data, "name", _is_text, "look")
    rows = tuple(_row(entry) for entry in _checked(data, "rows", _is_list, f"look '{name}'"))
    lights = tuple(_light(entry) for entry in _checked(data, "lights", _is_list, f"look '{name}'"))
    shots = _checked({"shots": {}} | data, "shots", lambda value: isinstance(value, dict), f"look '{name}'")
    return Look(name, rows, lights, {shot: _rows_of_shot(shots, shot) for shot in shots})


def _rows_of_shot(shots: dict[str, Any], shot: str) -> tuple[Row, ...]:
    where = f"shot {shot!r}"
    if not _is_text(shot):
        raise LookError(f"damaged look: {where} has no usable name")
    return tuple(_row(entry) for entry in _checked(shots, shot, _is_list, where))


def _row(entry: Any) -> Row:
    where = _where(entry, "row")
    return Row(
        name=_checked(entry, "name", _is_text, where),
        kind=_checked(entry, "kind", KINDS.__contains__, where),
        on=_checked(entry, "on", _is_flag, where),
        solo=_checked(entry, "solo", _is_flag, where),
        exposure=_checked(entry, "exposure", lambda value: _is_number(value) and abs(value) <= 100, where),
        multiplier=_checked(entry, "multiplier", lambda value: _is_number(value) and value >= 0, where),
        color=tuple(_checked(entry, "color", _is_color, where)),
        use_kelvin=_checked(entry, "use_kelvin", _is_flag, where),
        kelvin=_checked(entry, "kelvin", lambda value: _is_number(value) and value > 0, where),
    )


def _light(entry: Any) -> dict[str, Any]:
    where = _where(entry, "light")
    settings = _checked(entry, "settings", lambda value: isinstance(value, dict), where)
    return {
        "name": _checked(entry, "name", _is_text, where),
        "type": _checked(entry, "type", _is_text, where),
        "matrix": _checked(entry, "matrix", _is_matrix, where),
        "hidden": _checked(entry, "hidden", _is_flag, where),
        "settings": {key: _checked(settings, key, _is_setting, where) for key in settings},
        **({"added": True} if entry.get("added") is True else {}),
    }


def _where(entry: Any, kind: str) -> str:
    if not isinstance(entry, dict):
        raise LookError(f"damaged look: a {kind} is not an object")
    return f"{kind} {entry.get('name')!r}"


def _checked(data: dict[str, Any], key: str, is_good: Callable[[Any], bool], where: str) -> Any:
    value = data.get(key)
    if not is_good(value):
        raise LookError(f'damaged look: {where} has no usable "{key}" (found {json.dumps(value)[:40]})')
    return value


def _is_text(value: Any) -> bool:
    """True if Blender can store the value as a name."""
    return isinstance(value, str) and not any(char < " " or "\ud800" <= char <= "\udfff" for char in value)


def _is_flag(value: Any) -> bool:
    return isinstance(value, bool)


def _is_list(value: Any) -> bool:
    return isinstance(value, list)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e30


def _is_color(value: Any) -> bool:
    return _is_list(value) and len(value) == 3 and all(_is_number(channel) and channel >= 0 for channel in value)


def _is_matrix(value: Any) -> bool:
    return (
        _is_list(value)
        and len(value) == 4
        and all(_is_list(row) and len(row) == 4 and all(map(_is_number, row)) for row in value)
    )


def _is_setting(value: Any) -> bool:
    return _is_flag(value) or _is_text(value) or _is_number(value) or _is_color(value)
