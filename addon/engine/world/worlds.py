"""Worlds that Cycles renders over all directions, in a Blender of its own: what lights only by its direction can be an
environment texture. Called while a scene is read: in a window that is on a thread of Blender's own."""

from __future__ import annotations

import hashlib
import json
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...export.images import TextureSize, has_tile_files, is_as_in_file, tile_path
from ...export.node_graph import NodeGraph, WorldRenderError
from ...export.stop import Stop
from ...export.working_space import working_space
from ..workers.process import private_folder, run_to_end, telling_little_room

COMMAND = "render-world"
JOB, RESULT = "job.json", "world.npy"
WIDTH, LARGEST_WIDTH = 2048, 4096
"""Columns of the texture: the disc of the sun takes three of 2048. More where an image has more."""
KEPT = 2
"""Textures that are kept for worlds that come again, 32 MiB each at the usual width."""

_kept: OrderedDict[str, np.ndarray] = OrderedDict()
_lock = threading.Lock()


def rendered(world: NodeGraph, size: TextureSize, stop: Stop) -> np.ndarray:
    """The world, with its images in a size, as an equirectangular texture: RGBA [height, width, 4], bottom row first,
    scene-linear. One that was rendered lately is not rendered again. Waits; raises `ExportCancelled` soon after `stop`
    says so, and WorldRenderError."""
    return rendering(world, size)(stop)


def rendering(world: NodeGraph, size: TextureSize = None) -> Callable[[Stop], np.ndarray]:
    """Function that renders the world later, on any thread, like `rendered`. Reads now what that needs of Blender.
    Raises WorldRenderError."""
    contents = {name: _contents(image) for name, image in sorted(world.images.items())}
    widest = max([WIDTH, *(image.size[0] for image in world.images.values())])
    width = min(widest, LARGEST_WIDTH)
    job = world.content | {
        "working_space": working_space(),
        "size": [width, width // 2],
        "texture_size": size,
        "images": {name: found.description for name, found in contents.items()},
    }
    text = json.dumps(job, sort_keys=True)
    return lambda stop: _rendered(text, contents, stop)


def _rendered(text: str, contents: dict[str, _Contents], stop: Stop) -> np.ndarray:
    key = hashlib.sha256(text.encode()).hexdigest()
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            return _kept[key]
    try:
        pixels = _render(text, contents, stop)
    except OSError as error:
        raise WorldRenderError(str(error)) from error
    with _lock:
        _kept[key] = pixels
        while len(_kept) > KEPT:
            _kept.popitem(last=False)
    return pixels


def forget() -> None:
    """Forgets all textures."""
    with _lock:
        _kept.clear()


@dataclass(frozen=True)
class _Contents:
    """An image for the other Blender."""

    description: dict[str, Any]
    """JSON, other for other pixels."""
    file: str = ""
    """Name of the file beside the job that the pixels or the packed file go into."""
    data: bytes | np.ndarray | None = None


def _contents(image: bpy.types.Image) -> _Contents:
    settings = image.colorspace_settings
    common = {"space": settings.name, "is_data": settings.is_data, "alpha": image.alpha_mode}
    if has_tile_files(image):
        path = bpy.path.abspath(image.filepath, library=image.library)
        files = {tile.number: tile_path(path, tile.number) for tile in image.tiles}
        written = [[file, _written(file, image.name)] for file in files.values()]
        return _Contents(common | {"tiles": sorted(files), "file": path, "first": written[0][0], "written": written})
    if not is_as_in_file(image):
        if not len(image.pixels):
            raise WorldRenderError(f"image '{image.name}' has no pixels: is its file still there?")
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        name = _name(pixels.tobytes())
        shape = {"size": list(image.size), "channels": image.channels, "is_float": image.is_float}
        return _Contents(common | {"pixels": f"{name}.npy"} | shape, f"{name}.npy", pixels)
    if image.packed_file:
        name = _name(image.packed_file.data)
        return _Contents(common | {"file": name, "is_packed": True}, name, image.packed_file.data)
    path = bpy.path.abspath(image.filepath, library=image.library)
    return _Contents(common | {"file": path, "written": _written(path, image.name)})


def _written(path: str, image: str) -> list[int]:
    """Facts that change with an image's file."""
    try:
        found = Path(path).stat()
    except OSError as error:
        raise WorldRenderError(f"image '{image}' could not be read from {path or image}") from error
    return [found.st_size, found.st_mtime_ns]


def _name(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _render(job: str, contents: dict[str, _Contents], stop: Stop) -> np.ndarray:
    with private_folder() as folder:
        place = Path(folder)
        with telling_little_room(place):
            _write_job(place, job, contents)
        worker = run_to_end([COMMAND], place, stop)
        if worker.code != 0:
            raise WorldRenderError(worker.failure())
        return np.load(place / RESULT)


def _write_job(place: Path, job: str, contents: dict[str, _Contents]) -> None:
    (place / JOB).write_text(job, encoding="utf-8")
    for found in contents.values():
        if isinstance(found.data, bytes):
            (place / found.file).write_bytes(found.data)
        elif found.data is not None:
            np.save(place / found.file, found.data)
