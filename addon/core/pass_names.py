"""Names of the passes of a picture, which other programs know too."""

from __future__ import annotations

from collections.abc import Iterable

LONGEST = 63 - len("Combined_")
"""Blender cuts pass names after 63 bytes."""


def light_passes(lights: Iterable[str]) -> dict[str, str]:
    """`Combined_<light>` of each light by its name. As they stand in an EXR file (ASCII, no dots), with a number if
    another light has the name: the rule of `relume relight`, in Blender's length."""
    taken: set[str] = set()
    return {light: f"Combined_{_free_name(light, taken)}" for light in lights}


def _free_name(light: str, taken: set[str]) -> str:
    plain = "".join(c if " " <= c <= "~" and c != "." else "_" for c in light)[:LONGEST] or "light"
    name, number = plain, 2
    while name in taken:
        end = f"_{number}"
        name, number = plain[: LONGEST - len(end)] + end, number + 1
    taken.add(name)
    return name
