"""A bake's `view.png`: the scene's view as a table, so that programs without Blender show pictures as Blender does.
Layout and spacing follow `relume_image::ViewTransform`."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import bpy
import numpy as np

from .view_transform import displayed, is_standard, shaper_axis, view_key

SIZE = 65
START = 256
"""Bytes of the file that hold its stamp."""


def is_current(scene: bpy.types.Scene, path: Path) -> bool:
    """True if the file is of the scene's view, or if there is none and the view is the plain sRGB curve."""
    try:
        with path.open("rb") as file:
            return not is_standard(scene) and stamp(scene) in file.read(START)
    except FileNotFoundError:
        return is_standard(scene)


def stamp(scene: bpy.types.Scene) -> bytes:
    """Identifier of the scene's view in its file."""
    return b"Relume view\0%08x" % zlib.crc32(view_key(scene).encode())


def write_view_table(scene: bpy.types.Scene, path: Path, stamped: bytes = b"") -> None:
    """Writes the file of the scene's view: a 16-bit PNG of SIZE^2 by SIZE pixels, whole or not at all, or none for the
    plain sRGB curve. `stamped` is another scene's `stamp` that has the same view."""
    if is_standard(scene):
        path.unlink(missing_ok=True)
        return
    axis = shaper_axis(SIZE)
    colors = np.empty((SIZE, SIZE, SIZE, 3), np.float32)  # [green, blue, red, channel]
    colors[..., 0], colors[..., 1], colors[..., 2] = axis, axis[:, None, None], axis[:, None]
    shown = displayed(scene, colors.reshape(SIZE, SIZE * SIZE, 3))
    words = np.round(shown * 65535.0).astype(">u2").reshape(-1, 3 * SIZE * SIZE).view(np.uint8)
    unfiltered = np.zeros((len(words), 1), np.uint8)
    packed = zlib.compress(np.hstack([unfiltered, words]).tobytes(), 1)
    _write_png(path, (SIZE * SIZE, SIZE), stamped or stamp(scene), packed)


def _write_png(path: Path, size: tuple[int, int], text: bytes, packed: bytes) -> None:
    """Writes packed lines of 16-bit RGB, the top one first."""
    header = struct.pack(">IIBBBBB", *size, 16, 2, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"tEXt", text), (b"IDAT", packed), (b"IEND", b""))
    part = path.with_name(f".part-{path.name}")
    try:
        with part.open("wb") as file:
            file.write(b"\x89PNG\r\n\x1a\n")
            for kind, data in chunks:
                file.write(struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)))
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
