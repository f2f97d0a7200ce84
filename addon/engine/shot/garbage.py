"""Freezing of Python's garbage collector while shots are open.

The collector otherwise traverses all objects now and then, on whichever thread has just allocated memory. For Blender's
own modules, which are no garbage, that takes tens of milliseconds."""

from __future__ import annotations

import gc

_is_frozen = False
"""True while the collector is frozen by this module."""


def gc_freeze() -> None:
    """Excludes all present objects from garbage collection, unless somebody else has frozen it."""
    global _is_frozen
    if _is_frozen or not gc.get_freeze_count():
        gc.freeze()
        _is_frozen = True


def gc_unfreeze() -> None:
    """Returns all objects to garbage collection, if `gc_freeze` excluded them."""
    global _is_frozen
    if _is_frozen:
        gc.unfreeze()
        _is_frozen = False
