"""Memory that Blender is about to touch for the first time, on the thread that draws its window. Linux finds it page by
page, in a microsecond each; in a virtual machine whose host has taken free memory back, in ten."""

from __future__ import annotations

import mmap
from contextlib import suppress

import numpy as np


class FreshMemory:
    """Block of memory that is found and held, made on another thread. If there is not enough, it holds none: the code
    that needs it will fail and say so."""

    def __init__(self, size: int):
        self._memory: mmap.mmap | None = None
        with suppress(OSError):
            self._memory = mmap.mmap(-1, size)  # An allocator might keep what it is given back.
            np.ndarray(size // mmap.PAGESIZE, np.uint8, self._memory, strides=mmap.PAGESIZE).fill(1)

    def give_back(self) -> None:
        """Frees the block. Called by the thread that needs it next, right before: Linux gives a processor first the
        memory that it has freed last."""
        if self._memory is not None:
            self._memory.close()
