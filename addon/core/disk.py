"""Room on disks and in memory: what a bake takes, what is free, what there is."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

BYTES_PER_PATH = 55
"""Size of a path in a dump with 16 bounces: 47 in cornell_box, 57 in kitchen and modern_hall."""


def expected_size(size: tuple[int, int], samples: int) -> int:
    """Approximate size of a bake in bytes, from width and height in pixels and paths per pixel."""
    return size[0] * size[1] * samples * BYTES_PER_PATH


def free_space(folder: Path) -> int | None:
    """Bytes that are free on the disk of a folder, which may be one that is still to be made; None if that cannot be
    told."""
    try:
        return shutil.disk_usage(next(found for found in (folder, *folder.parents) if found.exists())).free
    except OSError:
        return None


def memory() -> int:
    """Bytes of memory that the machine has; 0 where that cannot be told, such as on Windows."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 0


def in_words(size: int) -> str:
    """Text of a size, for example `3.4 GB`."""
    for unit, step in (("GB", 1e9), ("MB", 1e6)):
        if size >= step:
            return f"{size / step:.1f} {unit}"
    return f"{size / 1e3:.0f} kB"
