"""The passes of a picture, under names which other programs know too."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .rows import SILENT

COMBINED, STATIC, WORLD = "Combined", "static", "world"
DEPTH, NORMAL, ALBEDO, CATCHER = "Depth", "Normal", "Diffuse Color", "Shadow Catcher"
AOVS = {DEPTH: "depth", NORMAL: "normal", ALBEDO: "albedo"}
"""Passes that no light changes, and what the native module calls them."""
LONGEST = 63
"""Bytes after which Blender cuts the name of a pass."""
LOBES = (
    "Emission",
    *("Diffuse Direct", "Diffuse Indirect", "Glossy Direct", "Glossy Indirect"),
    *("Transmission Direct", "Transmission Indirect", "Volume Direct", "Volume Indirect"),
)
"""Parts of a light's picture, as the native module calls them."""
SHORTEST = len("Combined_") + 8
"""Least length of a pass name, in bytes, under a layer whose own name leaves less. Blender may cut such names."""


def longest_in_file(layer: str) -> int:
    """Bytes of a pass name that Blender before 5.0 keeps in EXR files: it cuts `layer.pass.R` as a whole."""
    return max(LONGEST - len(layer.encode()) - len("..R"), SHORTEST)


def light_passes(lights: Iterable[str], longest: int = LONGEST, part: str = COMBINED) -> dict[str, str]:
    """`Combined_<light>` of each light by its name, or that of a part. As they stand in an EXR file (ASCII, no dots),
    with a number if another light has the name: the rule of `relume relight`, in so many bytes."""
    taken: set[str] = set()
    room = max(longest - len(f"{part}_"), SHORTEST - len("Combined_"))
    return {light: f"{part}_{_free_name(light, taken, room)}" for light in lights}


def only(content: dict[str, Any], name: str) -> dict[str, Any] | None:
    """Content (its "lights", "gains", "world" and "static") reduced to a single pass; None if there is no such pass."""
    if name in AOVS:
        return content | {"aov": AOVS[name]}
    passes = light_passes(light["name"] for light in content["lights"])
    if name not in {STATIC, WORLD, *passes.values()}:
        return None
    gains = {light: gain if passes.get(light) == name else SILENT for light, gain in content["gains"].items()}
    others = {other: content[other] if name == other else SILENT for other in (STATIC, WORLD)}
    return content | {"gains": gains} | others


def _free_name(light: str, taken: set[str], longest: int) -> str:
    plain = "".join(c if " " <= c <= "~" and c != "." else "_" for c in light)[:longest] or "light"
    name, number = plain, 2
    while name in taken:
        end = f"_{number}"
        name, number = plain[: longest - len(end)] + end, number + 1
    taken.add(name)
    return name
