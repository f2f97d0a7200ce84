"""Lines of text in the side bar of 3D views."""

from __future__ import annotations

import textwrap

import bpy

UNBROKEN = "\u00a0"
"""A space that no line ends at."""
MARGIN, ICON, CHARACTER = 72, 20, 6.3
"""Pixels beside the text of the sidebar, of an icon, and of a character on average, at a scale of 1."""


def characters(region: bpy.types.Region, with_icon: bool = False) -> int:
    """Number of characters that a line of the sidebar can hold."""
    scale = bpy.context.preferences.system.ui_scale or 1.0  # Without a window Blender has none.
    width = region.width / scale
    return max(int((width - MARGIN - ICON * with_icon) / CHARACTER), 16)


def lines(text: str, width: int) -> list[str]:
    """A text in lines of at most `width` characters, between words where that is possible, but not before a "%"."""
    wrapped = textwrap.wrap(text.replace(" %", f"{UNBROKEN}%"), width) or [""]
    return [line.replace(UNBROKEN, " ") for line in wrapped]
