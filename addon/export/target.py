"""Images of the artist's as targets and masks: scene-linear, of the picture's size, top row first."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from .view_transform import is_srgb_curve

ASPECT_TOLERANCE = 0.01
"""Relative difference of aspects that rounding of sizes explains."""
INVERSES = {"AgX": "AgX Base sRGB", "Filmic": "Filmic sRGB"}
"""Colour spaces of Blender that undo a view transform on an sRGB display."""
DISPLAY_FORMATS = {"BMP", "IRIS", "PNG", "JPEG", "JPEG2000", "TARGA", "TARGA_RAW", "WEBP", "TIFF"}
"""Formats of files with display colours, whatever their bits."""


class TargetError(Exception):
    """The image cannot be used; the message is one line for the artist."""


@dataclass(frozen=True)
class Picture:
    """Pixels of an image data-block, and their meaning."""

    name: str
    pixels: np.ndarray
    """[height, width, channels], bottom row first, as Blender holds them."""
    is_float: bool
    is_data: bool
    """True if the picture holds no colours: Blender has left the numbers as they are in the file."""
    is_display: bool
    """True if the picture holds display colours, whatever its bit depth."""


def pixels_of(image: bpy.types.Image, room: np.ndarray | None = None) -> Picture:
    """An image's pixels, in an array of that many numbers if there is `room`; Blender reads its file for it if it has
    not yet."""
    width, height = image.size
    count = width * height * image.channels
    flat = room if room is not None and room.size == count else np.empty(count, np.float32)
    image.pixels.foreach_get(flat)
    is_display = not image.is_float or (image.source == "FILE" and image.file_format in DISPLAY_FORMATS)
    is_data = image.colorspace_settings.is_data
    return Picture(image.name, flat.reshape(height, width, image.channels), image.is_float, is_data, is_display)


def read_target(
    scene: bpy.types.Scene, picture: Picture, colors: str, size: tuple[int, int]
) -> tuple[np.ndarray, str, bool]:
    """Reads a target as scene-linear colours [height, width, 3] of width and height `size`, top row first. Also returns
    how its colours were understood, and True if that is doubtful. `colors` is one of `RelumeSolve.target_colors`.
    Raises TargetError."""
    pixels = _fitted(picture, size)[..., :3]
    if not np.isfinite(pixels).all():
        raise TargetError(f"target '{picture.name}' has pixels that are not numbers")
    if pixels.max() <= 0.0:
        raise TargetError(f"target '{picture.name}' is all black")
    if colors == "LINEAR" or (colors == "AUTO" and not picture.is_display):
        linear = pixels if picture.is_float or picture.is_data else from_srgb(pixels)
        outcome = linear, "Target read as scene-linear light", False
    else:
        # Blender has made light of pixels with more than 8 bits, by the sRGB curve.
        shown = to_srgb(pixels) if picture.is_float and not picture.is_data else pixels
        outcome = (from_srgb(shown), "Target read as plain sRGB", False) if colors == "SRGB" else undone(scene, shown)
    return np.ascontiguousarray(outcome[0], np.float32), *outcome[1:]


def read_mask(picture: Picture, size: tuple[int, int]) -> np.ndarray:
    """A mask [height, width, 1] from 0 to 1 of width and height `size`, top row first. Raises TargetError."""
    pixels = _fitted(picture, size)
    mask = np.clip(pixels[..., :3].mean(axis=2) * pixels[..., 3], 0.0, 1.0)
    if not np.isfinite(mask).all():
        raise TargetError(f"mask '{picture.name}' has pixels that are not numbers")
    if mask.max() <= 0.0:
        raise TargetError(f"mask '{picture.name}' is all black, so it has no place in the picture")
    return np.ascontiguousarray(mask[..., None], np.float32)


def undone(scene: bpy.types.Scene, shown: np.ndarray) -> tuple[np.ndarray, str, bool]:
    """Scene-linear colours that the scene's view shows as `shown`, [height, width, 3] from 0 to 1, as far as the view
    can be undone. Also returns how, and True if that is doubtful."""
    view = scene.view_settings
    exposure, name = 2.0**view.exposure, view.view_transform
    shown = np.clip(shown, 0.0, 1.0)
    if is_srgb_curve(scene):
        return from_srgb(shown**view.gamma) / exposure, f"Target read as this scene displays it ({name})", False
    plain = view.look == "None" and not view.use_curve_mapping and not getattr(view, "use_white_balance", False)
    if plain and name in INVERSES and scene.display_settings.display_device == "sRGB":
        linear = through_blender(shown**view.gamma, INVERSES[name]) / exposure
        return linear, f"Target read as this scene displays it ({name})", False
    transform = f"{name} with its look, curves or white balance" if name in INVERSES else name
    return from_srgb(shown), f"Target read as plain sRGB: {transform} cannot be undone", True


def from_srgb(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, from encoded to linear."""
    encoded = np.maximum(encoded, 0.0)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, from linear to encoded."""
    linear = np.maximum(linear, 0.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)


def resized(pixels: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """A picture [height, width, channels] at width and height `size`: means over the areas of the new pixels."""
    return _averaged(_averaged(pixels, size[1]).swapaxes(0, 1), size[0]).swapaxes(0, 1)


def _averaged(pixels: np.ndarray, count: int) -> np.ndarray:
    """Means over `count` equal parts of the first axis, from its running sum."""
    before = pixels.shape[0]
    if before == count:
        return pixels
    total = np.zeros((before + 1, *pixels.shape[1:]), np.float64)
    np.cumsum(pixels, axis=0, out=total[1:], dtype=np.float64)
    edges = np.arange(count + 1) * (before / count)
    low = np.minimum(edges.astype(int), before - 1)
    share = (edges - low).reshape(-1, *[1] * (pixels.ndim - 1))
    at_edges = total[low] + share * (total[low + 1] - total[low])
    return np.diff(at_edges, axis=0) * (count / before)


def _fitted(picture: Picture, size: tuple[int, int]) -> np.ndarray:
    """RGBA, resized, top row first."""
    height, width, channels = picture.pixels.shape
    if width == 0 or height == 0:
        raise TargetError(f"image '{picture.name}' has no pixels: is its file still there?")
    if abs(width * size[1] / (height * size[0]) - 1.0) > ASPECT_TOLERANCE:
        frame = f"{size[0]} x {size[1]}"
        raise TargetError(
            f"image '{picture.name}' is {width} x {height} and the camera's frame {frame}: crop it to the same aspect"
        )
    pixels = resized(picture.pixels[::-1], size)
    if channels < 3:
        pixels = np.concatenate([pixels[..., :1]] * 3 + [pixels[..., 1:]], axis=2)
    return pixels if pixels.shape[2] == 4 else np.concatenate([pixels, np.ones_like(pixels[..., :1])], axis=2)


def through_blender(shown: np.ndarray, space: str) -> np.ndarray:
    """Display colours to scene-linear ones by Blender's own colour management, which works on files."""
    handle, name = tempfile.mkstemp(suffix=".exr", dir=bpy.app.tempdir or None)
    os.close(handle)
    try:
        _write_exr(shown, name)
        image = bpy.data.images.load(name)
        try:
            image.colorspace_settings.name = space
            pixels = np.empty(len(image.pixels), np.float32)
            image.pixels.foreach_get(pixels)
        finally:
            bpy.data.images.remove(image)
    finally:
        Path(name).unlink()
    return pixels.reshape(*shown.shape[:2], -1)[..., :3]


def _write_exr(colors: np.ndarray, path: str) -> None:
    pixels = np.ones((*colors.shape[:2], 4), np.float32)
    pixels[..., :3] = colors
    image = bpy.data.images.new("relume target", colors.shape[1], colors.shape[0], float_buffer=True)
    try:
        image.colorspace_settings.name = "Non-Color"
        image.pixels.foreach_set(pixels.reshape(-1))
        image.file_format, image.filepath_raw = "OPEN_EXR", path
        image.save()
    finally:
        bpy.data.images.remove(image)
