"""Memory that Blender is about to touch for the first time, on the thread that draws its window. Linux finds it page by
page, in a microsecond each; in a virtual machine whose host has taken free memory back, in ten."""

from __future__ import annotations

import mmap
from contextlib import suppress

import numpy as np


class FreshMemory:
    """So many bytes, which are found and held; to be made on another thread. Where there are not so many it has none:
    what needs them will say so."""

    def __init__(self, size: int):
        self._memory: mmap.mmap | None = None
        with suppress(OSError):
            self._memory = mmap.mmap(-1, size)  # An allocator might keep what it is given back.
            np.ndarray(size // mmap.PAGESIZE, np.uint8, self._memory, strides=mmap.PAGESIZE).fill(1)

    def give_back(self) -> None:
        """To be called by the thread that needs them next, right before: Linux gives a processor first what that one
        has given back last."""
        if self._memory is not None:
            self._memory.close()
