"""Memory that Blender is about to touch for the first time, on the thread that draws its window. Linux finds it page by
page, in a microsecond each; in a virtual machine whose host has taken free memory back, in ten."""

from __future__ import annotations

import mmap
import threading
from contextlib import suppress

import numpy as np


def begin_to_find(size: int) -> threading.Thread:
    """Finds so many bytes, on a thread that ends when they are there. They are free again then, and what Linux gives
    first: what came back last."""
    thread = threading.Thread(target=_find, args=(size,), name="relume-memory", daemon=True)
    thread.start()
    return thread


def _find(size: int) -> None:
    # An allocator might keep what it is given back. Where there is not so much, whoever needs it will say so.
    with suppress(OSError), mmap.mmap(-1, size) as memory:
        np.ndarray(size // mmap.PAGESIZE, np.uint8, memory, strides=mmap.PAGESIZE).fill(1)
