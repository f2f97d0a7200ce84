"""Images: pixels in bulk, with what is needed to read them as Cycles does.

Blender decodes an image, and hands out its pixels, with Python's lock held: its window stands still for as long. So the
native module decodes files, packed ones too, as far as it comes to the pixels that Blender has of them."""

from __future__ import annotations

import re
from typing import Any

import bpy
import numpy as np

from .arrays import touched
from .working_space import LINEAR_REC709, scene_linear_from_rec709, working_space

ALPHA = {"STRAIGHT": "straight", "PREMUL": "premultiplied", "CHANNEL_PACKED": "channel_packed", "NONE": "none"}
LINEAR_SPACES = {"Non-Color", "Raw", "Linear Rec.709", "Linear", "scene_linear", "Generic Data"}
SRGB_SPACES = {"sRGB", "Utility - sRGB - Texture"}
LAST_NUMBER = re.compile(r"\d+(?=[^\d/\\]*\.[^./\\]*$)")
"""Frame number in a file's name, without its extension, where it is one of a sequence."""
MAGENTA = np.array([[[255, 0, 255, 255]]], np.uint8)


class ImageExporter:
    """Exports each image once and remembers its number."""

    def __init__(self, builder: Any, frame: int):
        """Exports to a builder of a scene, at a frame."""
        self.builder = builder
        self.frame = frame
        """Frame of the scene, for images of a sequence."""
        self.numbers: dict[tuple[str, str], int] = {}

    def number(self, image: bpy.types.Image, user: str, settings: bpy.types.ImageUser) -> int:
        """Number of an image as a node's settings choose it; `user` names who asks, for messages."""
        path = path_of(image, settings, self.frame)
        key = image.name_full, path
        if key not in self.numbers:
            self.numbers[key] = self._export(image, path, user)
        return self.numbers[key]

    def missing(self, user: str) -> int:
        """Blender's magenta, for a texture node without an image file."""
        return self.builder.add_texture(user, MAGENTA, encoding="linear", alpha="none")

    def _export(self, image: bpy.types.Image, path: str, user: str) -> int:
        alpha = ALPHA.get(image.alpha_mode, "straight")
        note = note_on(image)
        colors = colors_of_file(image)
        if colors is not None:
            file = image.packed_file.data if image.packed_file else path
            scene_from_rec709 = None if working_space() == LINEAR_REC709 else scene_linear_from_rec709().tolist()
            number = self.builder.add_texture_file(
                image.name, file, colors=colors, alpha=alpha, scene_from_rec709=scene_from_rec709
            )
            if number is not None:
                if note and image.source == "TILED":
                    self.builder.warn(f"{user}: {note}")
                return number
        texels = self._texels(image)
        if texels is None:
            path = path or image.name
            self.builder.warn(f"{user}: image '{image.name}' could not be read from {path}; shown magenta")
            return self.missing(image.name)
        if note:
            self.builder.warn(f"{user}: {note}")
        if image.is_float and alpha == "straight" and is_in_memory(image):
            alpha = _associate(image, texels)
        return self.builder.add_texture(image.name, texels, encoding=self._encoding(image, user), alpha=alpha)

    def _texels(self, image: bpy.types.Image) -> np.ndarray | None:
        """RGBA [height, width, 4], bottom row first; None if there are no pixels."""
        width, height = image.size
        if width == 0 or height == 0 or image.channels == 0:
            return None
        values = touched(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        values = _as_rgba(values.reshape(height, width, image.channels))
        if image.is_float:
            return values
        np.multiply(values, 255.0, out=values)
        return np.rint(values, out=values).astype(np.uint8)

    def _encoding(self, image: bpy.types.Image, user: str) -> str:
        space = image.colorspace_settings.name
        # Blender has already converted float pixels to the scene's linear space.
        if image.is_float or space in LINEAR_SPACES:
            return "linear"
        if space not in SRGB_SPACES:
            self.builder.warn(f"{user}: colour space '{space}' of image '{image.name}' is taken as sRGB")
        return "srgb"


def is_in_memory(image: bpy.types.Image) -> bool:
    """True if Cycles asks Blender for the pixels, instead of a file on disk."""
    return image.source == "GENERATED" or image.is_dirty or image.packed_file is not None


def _associate(image: bpy.types.Image, texels: np.ndarray) -> str:
    """Changes float pixels of straight alpha in place to Cycles' reading of them; returns their alpha afterwards. Data
    stays as it is. Other pixels count as multiplied by alpha before Blender 5.2, and are multiplied since then."""
    if image.colorspace_settings.is_data:
        return "channel_packed"
    if bpy.app.version >= (5, 2, 0):
        texels[..., :3] *= texels[..., 3:]
    return "straight"


def colors_of_file(image: bpy.types.Image) -> str | None:
    """Meaning of the values in an image's file, by the native module's name; None if Blender may have other values than
    the file, or if the native module does not know the colour space."""
    is_one_of_several = image.source in {"TILED", "SEQUENCE"} and not image.is_dirty and not image.packed_files
    if not is_one_of_several and not is_as_in_file(image):
        return None
    if image.colorspace_settings.is_data:
        return "data"
    space = image.colorspace_settings.name
    return "linear" if space in LINEAR_SPACES else "srgb" if space in SRGB_SPACES else None


def path_of(image: bpy.types.Image, settings: bpy.types.ImageUser, frame: int) -> str:
    """Path of the file that a node shows in a frame of the scene: the first tile if there are several."""
    path = bpy.path.abspath(image.filepath, library=image.library)
    if image.source == "TILED":
        return tile_path(path, image.tiles[0].number)
    return numbered_path(path, frame_of(settings, frame)) if image.source == "SEQUENCE" else path


def numbered_path(path: str, number: int) -> str:
    """Path of a file of a sequence: the last number in the path of any of them is replaced."""
    digits = LAST_NUMBER.search(path)
    return path[: digits.start()] + str(number).zfill(len(digits[0])) + path[digits.end() :] if digits else path


def tile_path(path: str, number: int) -> str:
    """Path of a tile's file: 1001 is the first of the first ten."""
    v, u = divmod(number - 1001, 10)
    return path.replace("<UDIM>", str(number)).replace("<UVTILE>", f"u{u + 1}_v{v + 1}")


def frame_of(settings: bpy.types.ImageUser, frame: int) -> int:
    """Number of the image's picture that is shown in a frame of the scene, as in Blender's
    `BKE_image_user_frame_get`."""
    length = settings.frame_duration
    place = frame - settings.frame_start + 1
    place = (place - 1) % max(length, 1) + 1 if settings.use_cyclic else min(max(place, 0), length)
    return place + settings.frame_offset if length else 0


def note_on(image: bpy.types.Image) -> str:
    """Note on pictures of an image that are left out; empty if it has only one."""
    if image.source in {"MOVIE", "SEQUENCE"}:
        return f"image '{image.name}' is a {image.source.lower()}; the frame that Blender has of it is used"
    return f"image '{image.name}' is tiled; its first tile is used" if image.source == "TILED" else ""


def is_as_in_file(image: bpy.types.Image) -> bool:
    """True if an image shows the pixels of its one file, which may be packed."""
    if image.source != "FILE" or image.is_dirty:
        return False
    return not image.has_data or bool(image.filepath)  # Made in Blender: what is packed may lack the alpha that it has.


def _as_rgba(values: np.ndarray) -> np.ndarray:
    height, width, channels = values.shape
    if channels == 4:
        return values
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = values[..., :3] if channels == 3 else values[..., :1]
    return rgba
