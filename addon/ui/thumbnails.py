"""Small pictures of looks: text in the .blend file, icons in the panel."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import bpy
import bpy.utils.previews
import numpy as np

from ..export.view_transform import displayed
from ..viewport import view_table
from ..viewport.view_table import ViewTable

WIDTH = 192
"""Pixels of a thumbnail at most."""

_icons: Any = None


def encode(scene: bpy.types.Scene, image: np.ndarray) -> str:
    """A thumbnail of a scene-linear picture [height, width, 4], bottom row first, as the scene's view shows it. Blender
    itself, which takes its time to colour pixels, is asked only where the view is not known yet."""
    view = view_table.of(scene)
    return _text(displayed(scene, _small(image))) if view is None else encode_in(view, image)


def encode_in(view: ViewTable, image: np.ndarray) -> str:
    """Encodes like `encode`, in a view that is known already; needs no Blender, so it may run on any thread."""
    return _text(view.apply(_small(image)))


def _small(image: np.ndarray) -> np.ndarray:
    stride = max(1, image.shape[1] // (4 * WIDTH))  # A few pixels of each block are enough, and quick.
    image = image[::stride, ::stride, :3]
    step = -(-image.shape[1] // WIDTH)
    height, width = (max(1, size // step) for size in image.shape[:2])
    step = min(step, *image.shape[:2])
    blocks = image[: height * step, : width * step].reshape(height, step, width, step, 3)
    return np.ascontiguousarray(np.nan_to_num(blocks.mean(axis=(1, 3)), posinf=1e4), np.float32)


def _text(colors: np.ndarray) -> str:
    height, width = colors.shape[:2]
    pixels = np.round(colors * 255.0).astype(np.uint8)
    return f"{width} {height} {base64.b64encode(zlib.compress(pixels.tobytes())).decode()}"


def decode(text: str) -> np.ndarray:
    """Display colours of a thumbnail, [height, width, 3] from 0 to 255, bottom row first."""
    width, height, data = text.split(" ")
    pixels = np.frombuffer(zlib.decompress(base64.b64decode(data)), np.uint8)
    return pixels.reshape(int(height), int(width), 3)


def icon(key: str, text: str) -> int:
    """Icon number of a thumbnail; `key` tells it from all others. 0 without a picture."""
    global _icons
    if not text:
        return 0
    if _icons is None:
        _icons = bpy.utils.previews.new()
    preview = _icons.get(key)
    if preview is None:
        pixels = decode(text)
        preview = _icons.new(key)
        preview.image_size = (pixels.shape[1], pixels.shape[0])
        rgba = np.ones((*pixels.shape[:2], 4), np.float32)
        rgba[..., :3] = pixels / 255.0
        preview.image_pixels_float.foreach_set(rgba.reshape(-1))
    return preview.icon_id


def free() -> None:
    """Forgets all icons."""
    global _icons
    if _icons is not None:
        bpy.utils.previews.remove(_icons)
        _icons = None
