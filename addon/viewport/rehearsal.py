"""Another Blender compiles first what draws pictures: graphics drivers keep on disk what they have compiled, so that
this one's window finds it there and does not stand still. From Blender 5.2 on, the first that draws without a window.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import bpy
import gpu
import numpy as np

from ..engine import view_worker
from ..export.camera import film_size
from ..export.false_color import LEVELS
from . import shader, warm_up
from .view_table import View

SECONDS = 20.0
"""After which the window compiles for itself."""
COLOR_FORMAT, DEPTH_FORMAT = "SRGB8_A8", "DEPTH32F_STENCIL8"
"""What a 3D view is drawn into: drivers compile anew for other formats."""
EDGE = 64

_begun: float | None = None
_is_over = False


def is_due() -> bool:
    """Whether the window should wait for it before it compiles anything."""
    return hasattr(gpu, "init") and not (_is_over or bpy.app.background)


def work(scene: bpy.types.Scene) -> None:
    """A turn of having it done; where no other Blender can do it, it is over."""
    global _begun, _is_over
    _begun = _begun or time.monotonic()
    try:
        worker = view_worker.shared()
        worker.ask(view_worker.programs_of(film_size(scene.render)))
        worker.turn()
        _is_over = worker.is_finished
    except OSError:
        _is_over = True
    if not _is_over and time.monotonic() - _begun > SECONDS:
        view_worker.close()
        _is_over = True


def reset() -> None:
    """Forgets that it was done."""
    global _begun, _is_over
    _begun, _is_over = None, False


def perform(film: tuple[int, int]) -> Iterator[None]:
    """In the other Blender: compiles all that draws pictures of a size; yields when the most likely views are ready."""
    gpu.init()
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = *film, 100
    region = EDGE, EDGE
    color, depth = (gpu.types.GPUTexture(region, format=name) for name in (COLOR_FORMAT, DEPTH_FORMAT))
    with gpu.types.GPUFrameBuffer(depth_slot=depth, color_slots={"texture": color}).bind():
        for view in (View(None, 1.0, 1.0), _view_of_places()):
            shader.free()  # What Mesa looks for on disk changes once it has compiled something of a program.
            warm_up.draw_everything(region, view)
            yield


def _view_of_places() -> View:
    """Its table has another format than those of colours, which a view without a table is given as well."""
    return View(np.zeros((3, 3, 3, 4), np.float32), 1.0, 1.0, np.zeros((LEVELS, 3), np.float32))
