"""Stopping of long work in Blender."""

from __future__ import annotations

from collections.abc import Callable

Stop = Callable[[], bool]
"""Returns True if the work should end."""


class ExportCancelled(Exception):  # noqa: N818 -- what the user wanted is no error
    """The user or Blender stopped it."""
