"""Draws the strokes and rectangles of the scribble brush over the camera's frame, a colour for each meaning. The
picture shows the solver's input: how much of each place is covered, not the lines of the brush."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import bpy
import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from ..core import coverage
from ..core.strokes import FARTHEST, Meaning, Stroke
from . import camera_frame, light_marks
from .camera_frame import Rectangle

HEIGHT = 270
"""Height of the picture of the strokes, in pixels."""
BRUSH_CORNERS = 64
WIDEST = 4.0
"""Aspect from which on that picture does not get any wider."""

_live: tuple[int, Stroke] | None = None
"""The movement that is being made, and its scene."""
MOST_TEXTURES = 16
_textures: dict[Any, Any] = {}
"""Strokes on the graphics card, by themselves and the size of their picture."""


def set_live(scene: bpy.types.Scene, stroke: Stroke | None) -> None:
    """Shows a movement before it is kept."""
    global _live
    _live = None if stroke is None else (scene.session_uid, stroke)


def is_painting(scene: bpy.types.Scene) -> bool:
    """True while a stroke is being drawn."""
    return _live is not None and _live[0] == scene.session_uid


def live_stroke(scene: bpy.types.Scene) -> tuple[Stroke, ...]:
    """The movement that is being made in a scene, if there is one."""
    return (_live[1],) if _live is not None and is_painting(scene) else ()


def place_of(frame: Rectangle, x: float, y: float) -> tuple[float, float]:
    """Fractions of the picture, from its top left corner, of a pixel of the region."""
    place = (x - frame.left) / frame.width, (frame.top - y) / frame.height
    return tuple(min(max(value, -FARTHEST), FARTHEST) for value in place)


def draw(
    frame: Rectangle,
    strokes: tuple[Stroke, ...],
    rectangles: Iterable[tuple[Meaning, tuple[float, float, float, float]]],
) -> None:
    """Draws into the region of a 3D view, which is bound."""
    blend = gpu.state.blend_get()
    if strokes:
        gpu.state.blend_set("ALPHA_PREMULT")
        _draw_picture(frame, _picture(strokes, frame))
    gpu.state.blend_set("ALPHA")
    for meaning, rectangle in rectangles:
        _draw_outline(frame, rectangle, (*coverage.display_color(meaning), 1.0))
    gpu.state.blend_set(blend)


def draw_brush(place: tuple[float, float], radius: float, meaning: Meaning, scale: float) -> None:
    """Draws the brush's rim: light and dark, to be seen on any picture, and in the colour of its meaning."""
    color = (*coverage.display_color(meaning), 1.0)
    blend = gpu.state.blend_get()
    gpu.state.blend_set("ALPHA")
    for inset, paint in ((-1.0, light_marks.SHADE), (0.0, light_marks.PLAIN), (1.0, color), (2.0, color)):
        shrunk = max(radius - inset * scale, 1.0)
        light_marks.rings(np.array([place]), shrunk, np.array([paint], np.float32), BRUSH_CORNERS)
    gpu.state.blend_set(blend)


def camera_in(context: bpy.types.Context) -> bpy.types.Object | None:
    """The camera of a 3D view, whether that looks through it or not."""
    if context.space_data is None or context.space_data.type != "VIEW_3D" or context.region_data is None:
        return None
    return camera_frame.camera_of(context.scene, context.space_data)


def frame_in(context: bpy.types.Context) -> Rectangle | None:
    """The camera's frame in a 3D view that looks through its camera."""
    camera = camera_in(context)
    return None if camera is None else camera_frame.frame_of(context.scene, camera, context.region, context.region_data)


def current_frame_in(context: bpy.types.Context) -> Rectangle | None:
    """The camera's frame in a 3D view that looks through the scene's camera."""
    return frame_in(context) if camera_in(context) == context.scene.camera else None


def free() -> None:
    """Lets go of everything."""
    global _live
    _live = None
    _textures.clear()


def _picture(strokes: tuple[Stroke, ...], frame: Rectangle) -> Any:
    """The strokes on the graphics card; made anew when they are other ones."""
    size = (round(HEIGHT * min(frame.width / frame.height, WIDEST)), HEIGHT)
    if (strokes, size) not in _textures:
        while len(_textures) >= MOST_TEXTURES:
            del _textures[next(iter(_textures))]
        _textures[strokes, size] = _texture_of(strokes, size)
    return _textures[strokes, size]


def _texture_of(strokes: tuple[Stroke, ...], size: tuple[int, int]) -> Any:
    pixels = np.ascontiguousarray(coverage.painted(strokes, size)[::-1]).reshape(-1)
    buffer = gpu.types.Buffer("FLOAT", pixels.size, pixels)
    return gpu.types.GPUTexture(size, format="RGBA16F", data=buffer)


def _draw_picture(frame: Rectangle, texture: Any) -> None:
    corners = [
        (frame.left, frame.bottom),
        (frame.right, frame.bottom),
        (frame.right, frame.top),
        (frame.left, frame.top),
    ]
    shader = gpu.shader.from_builtin("IMAGE")
    square = {"pos": corners, "texCoord": [(0, 0), (1, 0), (1, 1), (0, 1)]}
    batch = batch_for_shader(shader, "TRIS", square, indices=[(0, 1, 2), (0, 2, 3)])
    shader.bind()
    shader.uniform_sampler("image", texture)
    batch.draw(shader)


def _draw_outline(frame: Rectangle, rectangle: tuple[float, ...], color: tuple[float, ...]) -> None:
    left, top, right, bottom = rectangle
    part = frame.part((left, 1.0 - bottom), (right, 1.0 - top))
    corners = [(part.left, part.bottom), (part.right, part.bottom), (part.right, part.top), (part.left, part.top)]
    corners.append(corners[0])
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "LINE_STRIP", {"pos": corners})
    shader.uniform_float("color", color)
    batch.draw(shader)
