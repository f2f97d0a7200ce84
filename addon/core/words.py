"""Many things of one kind in few words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

MOST_NAMES = 3
OF_ONE = re.compile(r"(?P<kind>light|object) '(?P<name>.+?)'(?P<said>:? .*)", re.DOTALL)
"""Message about a single light or object."""
OWNER = re.compile(r"(?P<kind>[a-z][a-z ]*?) '.+?'(?:, [a-z]+ '.+?')?(?=: |, | [a-z])(?::)?(?P<said>.*)", re.DOTALL)
"""Message about something that has a name."""
QUOTED = re.compile(r" ?'([^']*)'")
QUOTED_OR_NUMBER = re.compile(r"'[^']*'|(?<= )\d+(?:\.\d+)?(?= |$)")

PLURAL_VERBS = {"is": "are", "has": "have"}


def listed(names: Sequence[str]) -> str:
    """List of names, for example `'Key', 'Rim' and 'Fill'`; a long one is cut and says how many more there are."""
    said = [f"'{name}'" for name in names[:MOST_NAMES]]
    rest = len(names) - len(said)
    *first, last = [*said, *[f"{rest} more"] * (rest > 0)]
    return " and ".join([*[", ".join(first)] * bool(first), last])


@lru_cache(maxsize=8)
def grouped(notes: tuple[str, ...]) -> tuple[str, ...]:
    """Notes, where what is said of several lights or objects alike is said once, each number from its least to its
    most, in the place of the first."""
    groups: dict[str, list[re.Match[str] | None]] = {}
    for note in notes:
        found = OF_ONE.fullmatch(note)
        alike = f"{found['kind']} {_numberless(found['said'])}" if found else note
        groups.setdefault(alike, []).append(found)
    return tuple(_as_one([note for note in group if note]) or alike for alike, group in groups.items())


def _as_one(notes: list[re.Match[str]]) -> str:
    """One note of all that are alike; empty of none."""
    if len(notes) < 2:
        return "".join(note.string for note in notes)
    names = list(dict.fromkeys(note["name"] for note in notes))
    said = _with_ranges([note["said"] for note in notes])
    also = f", and likewise {listed(names[1:])}" if len(names) > 1 else ""
    comma = "," * (bool(also) and not said.startswith(":"))
    return f"{notes[0]['kind']} '{names[0]}'{also}{comma}{said}"


def _is_number(found: re.Match[str]) -> bool:
    return not found[0].startswith("'")


def _numberless(said: str) -> str:
    return QUOTED_OR_NUMBER.sub(lambda found: "#" if _is_number(found) else found[0], said)


def _with_ranges(said: list[str]) -> str:
    """Sentences that differ by their numbers only, as one."""
    numbers = [[found[0] for found in QUOTED_OR_NUMBER.finditer(text) if _is_number(found)] for text in said]
    ends = iter([(min(column, key=float), max(column, key=float)) for column in zip(*numbers, strict=True)])

    def range_of(found: re.Match[str]) -> str:
        if not _is_number(found):
            return found[0]
        least, most = next(ends)
        return least if least == most else f"{least} to {most}"

    return QUOTED_OR_NUMBER.sub(range_of, said[0])


class Kind(NamedTuple):
    """Warnings that say the same of several things."""

    title: str
    """Sentence without names, after how many there are; the whole sentence of a single one."""
    names: tuple[str, ...]
    """Names in each of them; none of a single one."""


@lru_cache(maxsize=8)
def by_kind(warnings: tuple[str, ...]) -> tuple[Kind, ...]:
    """Warnings by what they say besides names and numbers, each kind in the place of its first."""
    kinds: dict[str, list[str]] = {}
    for warning in dict.fromkeys(warnings):
        kinds.setdefault(_numberless(QUOTED.sub("", warning)), []).append(warning)
    return tuple(_kind(alike) for alike in kinds.values())


def _kind(warnings: list[str]) -> Kind:
    owners = [owner for owner in map(OWNER.fullmatch, warnings) if owner]
    if len(warnings) == 1 or len(owners) < len(warnings):
        return Kind(warnings[0], tuple(map(_names, warnings[1:])))
    said = _with_ranges([QUOTED.sub("", owner["said"]).strip() for owner in owners])
    title = _of_many(f"{len(warnings)} {_plural(owners[0]['kind'])}", said)
    return Kind(title, tuple(map(_names, warnings)))


def _of_many(many: str, said: str) -> str:
    """Sentence about several things from what is said of one."""
    verb, _, rest = said.partition(" ")
    if verb in PLURAL_VERBS:
        return f"{many} {PLURAL_VERBS[verb]} {rest}"
    return f"{many}, each: {said}" if verb == "its" else f"{many}: {said}"


def _names(warning: str) -> str:
    return ", ".join(QUOTED.findall(warning)) or warning


def _plural(kind: str) -> str:
    return f"{kind[:-1]}ies" if kind.endswith("y") else f"{kind}s"
