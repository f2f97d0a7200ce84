"""Images: pixels in bulk, with what is needed to read them as Cycles does.

Blender decodes an image, and hands out its pixels, with Python's lock held: its window stands still for as long. So the
native module decodes files, packed ones too, as far as it comes to the pixels that Blender has of them."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .arrays import touched
from .node_graph import SkyGraph, TextureOf, no_texture
from .point_images import PointImage, point_image
from .target import from_srgb
from .working_space import LINEAR_REC709, scene_linear_from_rec709, working_space

ALPHA = {"STRAIGHT": "straight", "PREMUL": "premultiplied", "CHANNEL_PACKED": "channel_packed", "NONE": "none"}
LINEAR_SPACES = {"Non-Color", "Raw", "Linear Rec.709", "Linear", "scene_linear", "Generic Data"}
SRGB_SPACES = {"sRGB", "Utility - sRGB - Texture"}
LAST_NUMBER = re.compile(r"\d+(?=[^\d/\\]*\.[^./\\]*$)")
"""Frame number in a file's name, without its extension, where it is one of a sequence."""
NO_SPACE = "Non-Color"
"""Colour space of values that stay as they are."""
MAGENTA = np.array([[[255, 0, 255, 255]]], np.uint8)


@dataclass(frozen=True)
class Encoded:
    """An image that only Blender can make scene-linear."""

    space: str
    """Blender's name of the colour space."""
    alpha: str
    """Blender's alpha mode."""
    file: str | bytes = ""
    """Path of the file, or what is in it."""
    pixels: np.ndarray | None = None
    """Pixels [height, width, 4] from 0 to 1 in the colour space, bottom row first, of what is in no file."""
    frame: int | None = None
    """Frame of a movie, from 1 on; None of a picture."""


TextureSize = tuple[int | None, float] | None
"""Most texels along a side of an image, if there is such a limit, and the largest share of them; None: it keeps its
size."""


def texture_size(scene: bpy.types.Scene) -> TextureSize:
    """The size to which Simplify limits the images of a final render."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None or not scene.render.use_simplify:
        return None
    largest = None if cycles.texture_limit_render == "OFF" else int(cycles.texture_limit_render)
    share = getattr(cycles, "texture_resolution_render", 1.0)  # From Blender 5.3 on.
    return None if largest is None and share >= 1.0 else (largest, share)


class ConvertError(Exception):
    """An image could not be made scene-linear; the message says why."""


Convert = Callable[[Encoded], np.ndarray]
"""Makes an image scene-linear: RGBA [height, width, 4], bottom row first, multiplied by alpha unless that is unrelated.
Raises ConvertError."""


def no_convert(_image: Encoded) -> np.ndarray:
    """Converts nothing."""
    raise ConvertError("there is no other Blender to convert it")


class ImageExporter:
    """Exports each image once and remembers its number."""

    def __init__(
        self,
        builder: Any,
        frame: int,
        convert: Convert = no_convert,
        size: TextureSize = None,
        rendered: TextureOf = no_texture,
        depsgraph: Any = None,
    ):
        """Exports to a builder of a scene, at a frame. 3D images of points are those of a depsgraph."""
        self.builder = builder
        self.size = size
        self.rendered = rendered
        self.depsgraph = depsgraph
        self.convert = convert
        self.frame = frame
        """Frame of the scene, for images of a sequence."""
        self.numbers: dict[tuple[str, str, int | None], int] = {}
        self.tile_numbers: dict[tuple[str, int], int | None] = {}
        self.skies: dict[str, int] = {}

    def number(self, image: bpy.types.Image, user: str, settings: bpy.types.ImageUser) -> int:
        """Number of an image as a node's settings choose it; `user` names who asks, for messages."""
        path = path_of(image, settings, self.frame)
        frame = max(1, frame_of(settings, self.frame)) if image.source == "MOVIE" else None
        key = image.name_full, path, frame
        if key not in self.numbers:
            shown = self._of_movie(image, path, frame, user) if frame is not None else None
            self.numbers[key] = self._export(image, path, user) if shown is None else shown
        return self.numbers[key]

    def _of_movie(self, image: bpy.types.Image, path: str, frame: int, user: str) -> int | None:
        """A frame of a movie; None if it cannot be read. Bytes stay as they are, as those of a picture."""
        known = image.colorspace_settings.name or "sRGB"  # It has none before it is first shown.
        colors = colors_of(image) or ("srgb" if known in SRGB_SPACES else None)
        colors = colors if keeps_bytes() or colors == "data" else None
        space = known if colors is None else NO_SPACE
        try:
            texels = self.convert(Encoded(space, "NONE", path, frame=frame))
        except ConvertError as error:
            self.builder.warn(f"{user}: frame {frame} of movie '{image.name}' could not be read ({error})")
            return None
        if colors is not None:
            texels = np.rint(255.0 * texels).astype(np.uint8)
        encoding = "srgb" if colors == "srgb" else "linear"
        return self._added(image, texels, encoding, "none")

    def sky(self, node: bpy.types.Node) -> int:
        """Number of an image of a Sky Texture over all directions, as Cycles has it. Raises WorldRenderError."""
        graph = SkyGraph(node)
        if graph.text not in self.skies:
            self.skies[graph.text] = self.rendered(graph, node.name)
        return self.skies[graph.text]

    def points(self, node: bpy.types.Node) -> PointImage:
        """The 3D image of a node Point Density."""
        return point_image(self.builder, node, self.depsgraph, self.size[0] if self.size else None)

    def missing(self, user: str) -> int:
        """Blender's magenta, for a texture node without an image file."""
        return self.builder.add_texture(user, MAGENTA, encoding="linear", alpha="none")

    def tiles(self, image: bpy.types.Image, user: str) -> list[dict[str, int]]:
        """Tiles of an image, each with its number and that of its texture; those that cannot be read are left out."""
        if image.is_dirty:
            self.builder.warn(f"{user}: unsaved paint on tiles of image '{image.name}' is left out; save the image")
        found = []
        for tile in image.tiles:
            key = image.name_full, tile.number
            if key not in self.tile_numbers:
                self.tile_numbers[key] = self._tile(image, tile, user)
            if (texture := self.tile_numbers[key]) is not None:
                found.append({"number": tile.number, "texture": texture})
        return found

    def _tile(self, image: bpy.types.Image, tile: bpy.types.UDIMTile, user: str) -> int | None:
        packed = next((each.packed_file for each in image.packed_files if each.tile_number == tile.number), None)
        path = bpy.path.abspath(image.filepath, library=image.library)
        if packed is None and getattr(tile, "is_generated_tile", False):
            return self._generated(image, tile, user)
        path = tile_path(path, tile.number)
        file = packed.data if packed else path
        colors = colors_of(image)
        number = self._decoded(image, file, colors if keeps_bytes() or colors == "data" else None)
        if number is not None:
            return number
        try:
            if isinstance(file, str) and not Path(file).is_file():
                raise ConvertError(f"there is no file {file}" if file else "it is in no file; save the image")
            return self._converted(image, Encoded(image.colorspace_settings.name, image.alpha_mode, file))
        except ConvertError as error:
            words = f"tile {tile.number} of image '{image.name}' could not be read ({error}); shown magenta"
            self.builder.warn(f"{user}: {words}")
            return None

    def _converted(self, image: bpy.types.Image, encoded: Encoded) -> int:
        texels = self.convert(encoded)
        return self._added(image, texels, "linear", ALPHA.get(image.alpha_mode, "straight"))

    def _added(self, image: bpy.types.Image, texels: np.ndarray, encoding: str, alpha: str) -> int:
        return self.builder.add_texture(image.name, texels, encoding=encoding, alpha=alpha, size=self.size)

    def _generated(self, image: bpy.types.Image, tile: bpy.types.UDIMTile, user: str) -> int:
        """A tile that no file holds, as one texel of its colour."""
        if tile.generated_type != "BLANK":
            self.builder.warn(
                f"{user}: the grid of tile {tile.number} of image '{image.name}' is left out; save the image"
            )
        color = np.array(tile.generated_color, np.float32).reshape(1, 1, 4)
        is_linear = tile.use_generated_float or colors_of(image) in {"linear", "data"}
        texels = color if tile.use_generated_float else np.rint(255.0 * color).astype(np.uint8)
        return self._added(image, texels, "linear" if is_linear else "srgb", ALPHA.get(image.alpha_mode, "straight"))

    def _decoded(self, image: bpy.types.Image, file: Any, colors: str | None) -> int | None:
        """A file, or the bytes of one, as the native module decodes it; None if it cannot."""
        if colors is None:
            return None
        alpha = ALPHA.get(image.alpha_mode, "straight")
        scene_from_rec709 = None if working_space() == LINEAR_REC709 else scene_linear_from_rec709().tolist()
        return self.builder.add_texture_file(
            image.name, file, colors=colors, alpha=alpha, scene_from_rec709=scene_from_rec709, size=self.size
        )

    def _export(self, image: bpy.types.Image, path: str, user: str) -> int:
        alpha = ALPHA.get(image.alpha_mode, "straight")
        note = note_on(image)
        colors = colors_of_file(image)
        if colors in {"srgb", "linear"} and not keeps_bytes() and not image.is_float:
            colors = None
        if colors is not None:
            number = self._decoded(image, image.packed_file.data if image.packed_file else path, colors)
            if number is not None:
                if note and image.source == "TILED":
                    self.builder.warn(f"{user}: {note}")
                return number
        is_unknown = colors_of(image) is None or (is_one_of_several(image) and not keeps_bytes())
        if is_unknown and (encoded := self._encoded(image, path)) is not None:
            try:
                return self._converted(image, encoded)
            except ConvertError as error:
                space = image.colorspace_settings.name
                words = f"colour space '{space}' of image '{image.name}' is taken as sRGB ({error})"
                self.builder.warn(f"{user}: {words}")
        texels = self._texels(image)
        if texels is None:
            path = path or image.name
            self.builder.warn(f"{user}: image '{image.name}' could not be read from {path}; shown magenta")
            return self.missing(image.name)
        if note:
            self.builder.warn(f"{user}: {note}")
        if image.is_float and alpha == "straight" and is_in_memory(image):
            alpha = _associate(image, texels)
        colors = "linear" if image.is_float else colors_of(image) or "srgb"
        if not image.is_float and colors != "data" and not keeps_bytes():
            texels, colors = _scene_linear(texels, alpha, colors), "linear"
        encoding = "srgb" if colors == "srgb" else "linear"
        return self._added(image, texels, encoding, alpha)

    def _encoded(self, image: bpy.types.Image, path: str) -> Encoded | None:
        """An image whose colour space the native module does not know; None if Blender has it scene-linear already, or
        has no pixels of it."""
        space, alpha = image.colorspace_settings.name, image.alpha_mode
        if is_one_of_several(image) or is_as_in_file(image):
            return Encoded(space, alpha, image.packed_file.data if image.packed_file else path)
        width, height = image.size
        if image.is_float or 0 in (width, height, image.channels):
            return None
        values = np.empty(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        return Encoded(space, alpha, pixels=as_rgba(values.reshape(height, width, image.channels)))

    def _texels(self, image: bpy.types.Image) -> np.ndarray | None:
        """RGBA [height, width, 4], bottom row first; None if there are no pixels."""
        width, height = image.size
        if width == 0 or height == 0 or image.channels == 0:
            return None
        values = touched(width * height * image.channels, np.float32)
        image.pixels.foreach_get(values)
        values = as_rgba(values.reshape(height, width, image.channels))
        if image.is_float:
            return values
        np.multiply(values, 255.0, out=values)
        return np.rint(values, out=values).astype(np.uint8)


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
    return colors_of(image) if is_one_of_several(image) or is_as_in_file(image) else None


def is_one_of_several(image: bpy.types.Image) -> bool:
    """True if an image shows one file of several, as it is there."""
    return image.source in {"TILED", "SEQUENCE"} and not image.is_dirty and not image.packed_files


def colors_of(image: bpy.types.Image) -> str | None:
    """Meaning of an image's values as its settings say, by the native module's name; None of a colour space that it
    does not know."""
    if image.colorspace_settings.is_data:
        return "data"
    space = image.colorspace_settings.name
    return "linear" if space in LINEAR_SPACES else "srgb" if space in SRGB_SPACES else None


def keeps_bytes() -> bool:
    """True if colours of 8 bits stay as they are: their primaries are those of the scene."""
    return working_space() == LINEAR_REC709


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


def has_tile_files(image: bpy.types.Image) -> bool:
    """True if an image has tiles that show the pixels of their files."""
    return image.source == "TILED" and not image.packed_files and not image.is_dirty


def is_as_in_file(image: bpy.types.Image) -> bool:
    """True if an image shows the pixels of its one file, which may be packed."""
    if image.source != "FILE" or image.is_dirty:
        return False
    return not image.has_data or bool(image.filepath)  # Made in Blender: what is packed may lack the alpha that it has.


def _scene_linear(texels: np.ndarray, alpha: str, colors_are: str) -> np.ndarray:
    """Floats in a working space of other primaries, multiplied by alpha unless that is unrelated, of bytes that hold
    sRGB or linear Rec.709."""
    values = texels.astype(np.float32) / 255.0
    linear = from_srgb(values[..., :3]).astype(np.float32) if colors_are == "srgb" else values[..., :3]
    colors = linear @ scene_linear_from_rec709().T
    if alpha == "straight":
        colors *= values[..., 3:]
    return np.concatenate([colors, values[..., 3:]], axis=2)


def as_rgba(values: np.ndarray) -> np.ndarray:
    """Pixels of one to four channels as RGBA."""
    height, width, channels = values.shape
    if channels == 4:
        return values
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = values[..., :3] if channels == 3 else values[..., :1]
    return rgba
