"""Shader precompilation in another Blender, which fills the disk cache of the graphics driver.

This Blender's window finds the shaders there and does not stand still. Needs Blender 5.2, the first version that draws
without a window.
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

from ..engine.shot.options import user_folder
from ..engine.workers import view_worker
from ..export.camera import film_size
from ..export.false_color import LEVELS
from . import precompilation, shader
from .view_table import View

SECONDS = 20.0
"""Time after which the window compiles for itself."""
COLOR_FORMAT, DEPTH_FORMAT = "SRGB8_A8", "DEPTH32F_STENCIL8"
"""Formats of a 3D view's textures: drivers compile again for other ones."""
EDGE = 64
FOLDER = "compiled"
"""User folder with an empty file for each compiled set of shaders, so that later sessions need not wait for it."""

_done: set[str] = set()
"""Names of those files that are known to exist."""
_begun: float | None = None
_is_refused = False


def is_due(scene: bpy.types.Scene) -> bool:
    """True if the window should wait for the other Blender before it compiles the shaders of a scene."""
    if _is_refused or bpy.app.background or not hasattr(gpu, "init") or _is_for_later_sessions():
        return False
    name = _name(*precompilation.film_like(film_size(scene.render)))
    if name not in _done and (user_folder(FOLDER) / name).exists():
        _done.add(name)
    return name not in _done


def step(scene: bpy.types.Scene) -> None:
    """Polls the other Blender, starting it if needed. Where none can compile, none is asked again."""
    global _begun, _is_refused
    film = precompilation.film_like(film_size(scene.render))
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
    """Resets the time limit when another file is about to be opened."""
    global _begun
    _begun = None


def reset() -> None:
    """Forgets all that was compiled in this session."""
    global _is_refused
    interrupt()
    _done.clear()
    _is_refused = False


def precompile(film: tuple[int, int]) -> Iterator[None]:
    """Compiles all shaders for pictures of a size, a piece at a time. Runs in the other Blender."""
    gpu.init()
    region = EDGE, EDGE
    color, depth = (gpu.types.GPUTexture(region, format=name) for name in (COLOR_FORMAT, DEPTH_FORMAT))
    drawn_into = gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots={"texture": color})
    # Tables of places have another format than those of colours.
    table, levels = np.zeros((3, 3, 3, 4), np.float32), np.zeros((LEVELS, 3), np.float32)
    for view in (View(None, 1.0, 1.0), View(table, 1.0, 1.0), View(table.copy(), 1.0, 1.0, levels)):
        shader.free()  # What Mesa looks for on disk changes once it has compiled something of a program.
        for draw_piece in precompilation.all_pieces(film, region, view):
            with drawn_into.bind():
                draw_piece()
            yield


def _is_for_later_sessions() -> bool:
    """True for NVIDIA's OpenGL: a running program does not see what others have added to its disk cache."""
    return (gpu.platform.vendor_get(), gpu.platform.backend_type_get()) == ("NVIDIA Corporation", "OPENGL")


@cache
def _name(*film: int) -> str:
    """Name of the shaders for pictures of a size, under the present driver, Blender and Relume."""
    driver = gpu.platform
    by = driver.vendor_get(), driver.renderer_get(), driver.version_get(), driver.backend_type_get(), bpy.app.build_hash
    return hashlib.sha1(repr((by, shader.VERTEX, shader.FRAGMENT, film)).encode()).hexdigest()


def _note(name: str) -> None:
    _done.add(name)
    with suppress(OSError):  # Then the next session waits for it as well.
        user_folder(FOLDER).mkdir(parents=True, exist_ok=True)
        (user_folder(FOLDER) / name).touch()
