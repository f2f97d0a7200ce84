"""Fingerprints of volumes, and of the files behind them."""

from __future__ import annotations

import os
from collections.abc import Iterable

import bpy

from ...core.diff import Fingerprint
from ...export.images import numbered_path
from ...export.volumes import smoke_domain
from .node_fingerprints import hashed, values


def stamp(path: str) -> tuple[int, int] | None:
    """Size and modification time of a file; None if it cannot be read."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


def volume(block: bpy.types.Volume) -> Fingerprint:
    """Fingerprint of a volume and the file behind it, which is that of the frame where they are a sequence."""
    path = bpy.path.abspath(block.filepath, library=block.library)
    if block.is_sequence:
        path = numbered_path(path, block.grids.frame)
    settings = [values(block), values(block.render), block.is_sequence]
    return {"settings": hashed(settings), "file": hashed([path, stamp(path)])}


def smoke(objects: Iterable[bpy.types.Object], frame: int) -> Fingerprint:
    """The frame, where a smoke domain shows another picture in each."""
    return {obj.name_full: f"frame {frame}" for obj in objects if obj.modifiers and smoke_domain(obj)}
