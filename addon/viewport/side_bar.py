"""Lines of text in the side bar of 3D views."""

from __future__ import annotations

import textwrap

import blf
import bpy

UNBROKEN = "\u00a0"
"""A space that no line ends at."""
MARGIN, ICON, CHARACTER = 72, 20, 6.3
"""Pixels beside the text of the sidebar, of an icon, and of a character on average, at a scale of 1."""
TAIL = 4
"""Most characters that a shortened name keeps of its end, where numbers are."""


def characters(region: bpy.types.Region, with_icon: bool = False) -> int:
    """Number of characters that a line of the sidebar can hold."""
    scale = bpy.context.preferences.system.ui_scale or 1.0  # Without a window Blender has none.
    width = region.width / scale
    return max(int((width - MARGIN - ICON * with_icon) / CHARACTER), 16)


def lines(text: str, width: int) -> list[str]:
    """A text in lines of at most `width` characters, between words where that is possible, but not before a "%"."""
    wrapped = textwrap.wrap(text.replace(" %", f"{UNBROKEN}%"), width) or [""]
    return [line.replace(UNBROKEN, " ") for line in wrapped]


def elided(name: str, width: float) -> str:
    """A name that fits into pixels at a scale of 1, without its middle if it is too long: numbered lamps differ at
    their ends, which Blender would cut off."""
    blf.size(0, bpy.context.preferences.ui_styles[0].widget.points)
    for end in range(len(name), TAIL, -1):
        shown = name if end == len(name) else f"{name[: end - TAIL].rstrip()}…{name[-TAIL:].lstrip()}"
        if blf.dimensions(0, shown)[0] <= width:
            return shown
    return name
