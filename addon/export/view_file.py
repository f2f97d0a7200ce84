"""A bake's `view.png`: the scene's view as a table, so that what needs no Blender shows pictures as Blender does.

Layout and spacing are those of `relume_image::ViewTransform`."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from .view_transform import displayed_in_slices, is_standard, shaper_axis, view_key

SIZE = 65
START = 256
"""Bytes of the file that hold its stamp."""


def is_current(scene: bpy.types.Scene, path: Path) -> bool:
    """Whether the file is of the scene's view; of the plain sRGB curve there is none."""
    try:
        with path.open("rb") as file:
            return not is_standard(scene) and _stamp(scene) in file.read(START)
    except FileNotFoundError:
        return is_standard(scene)


def _stamp(scene: bpy.types.Scene) -> bytes:
    return b"Relume view\0%08x" % zlib.crc32(repr(view_key(scene)).encode())


def write_view_table(scene: bpy.types.Scene, path: Path) -> None:
    """Makes the file that of the scene's view, at once; see `view_table_slices`."""
    for _ in view_table_slices(scene, path):
        pass


def view_table_slices(scene: bpy.types.Scene, path: Path) -> Iterator[None]:
    """Makes the file that of the scene's view, a slice at each step: a 16-bit PNG of SIZE^2 by SIZE pixels, whole or
    not at all, or none for the plain sRGB curve."""
    if is_standard(scene):
        path.unlink(missing_ok=True)
        return
    stamp, axis = _stamp(scene), shaper_axis(SIZE)
    line = np.empty((SIZE, SIZE, 3), np.float32)  # [blue, red, channel]
    line[..., 0], line[..., 2] = axis, axis[:, None]

    def lines(rows: slice) -> np.ndarray:
        colors = np.repeat(line[None], len(axis[rows]), axis=0)  # [green, blue, red, channel]
        colors[..., 1] = axis[rows, None, None]
        return colors.reshape(-1, SIZE * SIZE, 3)

    packer, packed = zlib.compressobj(1), []
    for _, shown in displayed_in_slices(scene, SIZE, SIZE * SIZE, lines):
        words = np.round(shown * 65535.0).astype(">u2").reshape(-1, 3 * SIZE * SIZE).view(np.uint8)
        unfiltered = np.zeros((len(words), 1), np.uint8)
        packed.append(packer.compress(np.hstack([unfiltered, words]).tobytes()))
        yield None
    if stamp == _stamp(scene):  # Else some slices are of another view.
        _write_png(path, (SIZE * SIZE, SIZE), stamp, b"".join([*packed, packer.flush()]))


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
