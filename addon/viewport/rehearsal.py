"""Another Blender compiles first what draws pictures: graphics drivers keep on disk what they have compiled, so that
this one's window finds it there and does not stand still. From Blender 5.2 on, the first that draws without a window.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import cache

import bpy
import gpu
import numpy as np

from ..engine import view_worker
from ..engine.options import user_folder
from ..export.camera import film_size
from ..export.false_color import LEVELS
from . import shader, warm_up
from .view_table import View

SECONDS = 20.0
"""After which the window compiles for itself."""
COLOR_FORMAT, DEPTH_FORMAT = "SRGB8_A8", "DEPTH32F_STENCIL8"
"""What a 3D view is drawn into: drivers compile anew for other formats."""
EDGE = 64
FOLDER = "compiled"
"""Of the user: an empty file for each thing that was compiled once, so that later sessions need not wait for it."""

_done: set[str] = set()
"""Their names, as far as they were looked for."""
_begun: float | None = None
_is_refused = False


def is_due(scene: bpy.types.Scene) -> bool:
    """Whether the window should wait for it before it compiles what draws a scene."""
    if _is_refused or bpy.app.background or not hasattr(gpu, "init") or _is_for_later_sessions():
        return False
    name = _name(*warm_up.film_like(film_size(scene.render)))
    if name not in _done and (user_folder(FOLDER) / name).exists():
        _done.add(name)
    return name not in _done


def work(scene: bpy.types.Scene) -> None:
    """A turn of having it done; where no other Blender can do it, none is asked again."""
    global _begun, _is_refused
    film = warm_up.film_like(film_size(scene.render))
    _begun = _begun or time.monotonic()
    try:
        worker = view_worker.shared()
        worker.ask(view_worker.programs_of(film))
        worker.turn()
    except OSError:
        _is_refused = True
        return
    if worker.is_finished:
        _begun = None
        _note(_name(*film))
    elif time.monotonic() - _begun > SECONDS:
        worker.drop(at_once=True)
        _is_refused = True


def interrupt() -> None:
    """Another file is about to be opened: what has passed since it was begun does not count."""
    global _begun
    _begun = None


def reset() -> None:
    """Forgets what was done in this session."""
    global _is_refused
    interrupt()
    _done.clear()
    _is_refused = False


def perform(film: tuple[int, int]) -> Iterator[None]:
    """In the other Blender: compiles all that draws pictures of a size, a piece at a time."""
    gpu.init()
    region = EDGE, EDGE
    color, depth = (gpu.types.GPUTexture(region, format=name) for name in (COLOR_FORMAT, DEPTH_FORMAT))
    drawn_into = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots={"texture": color})
    # Tables of places have another format than those of colours.
    table, levels = np.zeros((3, 3, 3, 4), np.float32), np.zeros((LEVELS, 3), np.float32)
    for view in (View(None, 1.0, 1.0), View(table, 1.0, 1.0), View(table.copy(), 1.0, 1.0, levels)):
        shader.free()  # What Mesa looks for on disk changes once it has compiled something of a program.
        for draw_piece in warm_up.all_pieces(film, region, view):
            with drawn_into.bind():
                draw_piece()
            yield


def _is_for_later_sessions() -> bool:
    """NVIDIA's OpenGL does not look again on disk for what others have compiled since a program began."""
    return (gpu.platform.vendor_get(), gpu.platform.backend_type_get()) == ("NVIDIA Corporation", "OPENGL")


@cache
def _name(*film: int) -> str:
    """Of what draws pictures of a size by the present driver, Blender and Relume."""
    driver = gpu.platform
    by = driver.vendor_get(), driver.renderer_get(), driver.version_get(), driver.backend_type_get(), bpy.app.build_hash
    return hashlib.sha1(repr((by, shader.VERTEX, shader.FRAGMENT, film)).encode()).hexdigest()


def _note(name: str) -> None:
    _done.add(name)
    with suppress(OSError):  # Then the next session waits for it as well.
        user_folder(FOLDER).mkdir(parents=True, exist_ok=True)
        (user_folder(FOLDER) / name).touch()
