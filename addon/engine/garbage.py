"""What Python leaves out when it looks for garbage while shots are open. Otherwise it looks through everything now and
then, on whichever thread has just asked for memory: tens of milliseconds, for
Blender's own modules, which are none."""

from __future__ import annotations

import gc

_is_spared = False


def spare() -> None:
    """From now on what is there now is left out."""
    global _is_spared
    if _is_spared or not gc.get_freeze_count():  # Somebody else's is left as it is.
        gc.freeze()
        _is_spared = True


def spare_nothing() -> None:
    """Puts everything back."""
    global _is_spared
    if _is_spared:
        gc.unfreeze()
        _is_spared = False
