"""Draws the newest frame into the camera's rectangle of every 3D view that looks through the baked camera.

The picture goes over the scene and under the gizmos (POST_VIEW), the words over everything (POST_PIXEL). Nothing here
computes or waits: a view table that is not there yet is made by a timer, a slice at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ..engine import shot
from . import camera_frame, compare, shader, texture, view_table
from .camera_frame import Rectangle
from .view_table import View

SINGLE, SPLIT, DIFFERENCE = 0, 1, 2
"""Modes of the shader."""
NEVER = 1e9
"""A split that no pixel reaches."""
WORDS_POINTS = 11.0
MARGIN_POINTS = 14.0

_handles: list[Any] = []


@dataclass(frozen=True)
class Show:
    """What to draw where; rectangles and the split in pixels of the region."""

    region: tuple[int, int]
    frame: Rectangle
    drawn: Rectangle
    first: Any
    second: Any
    mode: int = SINGLE
    split: float = NEVER
    opacity: float = 1.0
    gain: float = 1.0


def draw(what: Show, view: View, to_overlay: bool = True) -> None:
    """Draws frames into the bound framebuffer: that of a 3D view's overlay, or with `to_overlay` off one that takes
    display colours as they are."""
    first = texture.picture_of(what.first)
    second = texture.picture_of(what.second)
    pictures = first.developed(view), second.developed(view)
    frame = what.frame.snapped(first.size) or what.frame
    drawn = frame if what.drawn == what.frame else what.drawn
    program = shader.show()
    with _state():
        program.shader.bind()
        program.shader.uniform_sampler("first", pictures[0])
        program.shader.uniform_sampler("second", pictures[1])
        program.shader.uniform_float("frame", (frame.left, frame.bottom, frame.right, frame.top))
        program.shader.uniform_float("drawn", (drawn.left, drawn.bottom, drawn.right, drawn.top))
        program.shader.uniform_float("region", what.region)
        program.shader.uniform_float("split", what.split)
        program.shader.uniform_float("opacity", what.opacity)
        program.shader.uniform_float("gain", what.gain)
        program.shader.uniform_int("mode", what.mode)
        program.shader.uniform_int("to_overlay", int(to_overlay))
        program.square.draw(program.shader)


@contextmanager
def _state() -> Iterator[None]:
    """Premultiplied blending without depth; Blender's own state is put back."""
    blend, depth, mask = gpu.state.blend_get(), gpu.state.depth_test_get(), gpu.state.depth_mask_get()
    gpu.state.blend_set("ALPHA_PREMULT")
    gpu.state.depth_test_set("NONE")
    gpu.state.depth_mask_set(False)
    try:
        yield
    finally:
        gpu.state.blend_set(blend)
        gpu.state.depth_test_set(depth)
        gpu.state.depth_mask_set(mask)
