"""Overlay that a 3D view shows inside of the camera's rectangle. Nothing here computes or waits: it draws the newest
frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import bpy
import gpu

from ..core import status
from ..engine.shot import listed_view, open_shots
from ..engine.shot.shot import Shot
from . import camera_frame, compare, shader, texture
from .camera_frame import Rectangle
from .view_table import ViewTable

SINGLE, SPLIT, DIFFERENCE = 0, 1, 2
"""Modes of the shader."""
NEVER = 1e9
"""A split that no pixel reaches."""


@dataclass(frozen=True)
class Show:
    """Pictures to draw and where; rectangles and the split are in pixels of the region."""

    region: tuple[int, int]
    frame: Rectangle
    drawn: Rectangle
    first: Any
    second: Any
    mode: int = SINGLE
    split: float = NEVER
    opacity: float = 1.0
    gain: float = 1.0
    labels: tuple[str, str] = ("Relume", "View")
    """Names of the sides left and right of the split."""
    title: str = ""
    """Words on a shot beside the current one, of which the side bar speaks."""


def what_to_show(
    scene: bpy.types.Scene,
    space: bpy.types.SpaceView3D,
    region: bpy.types.Region,
    region_data: bpy.types.RegionView3D,
) -> Show | str | None:
    """Pictures to draw, or a hint why there are none; None where no shot is open."""
    settings, found = scene.relume_view, open_shots.all_of(scene)
    if not found or not settings.shown or region_data.view_perspective == "ORTHO":
        return None
    camera = camera_frame.camera_of(scene, space)
    frame = camera_frame.frame_of(scene, camera, region, region_data)
    shot = open_shots.showing(scene, camera) if frame is not None else None
    if shot is None:
        return words_without_shot(scene, camera if frame is not None else None)
    is_current = shot is open_shots.of(scene)
    live, pair = shot.picture, compare.pair_of(scene) if is_current else None
    first, second = (pair.a, pair.b or live) if pair else (live, live)
    if first is None or second is None:
        return words_without_picture(shot)
    mode = settings.compare if pair else "B"
    drawn = frame.part(*camera_frame.border_of(scene))
    options = {"opacity": settings.opacity, "gain": settings.difference_gain}
    if not is_current:
        options["title"] = _title(scene, camera, shot)
    if mode == "WIPE":
        options |= {"mode": SPLIT, "split": split_of(scene, frame), "labels": pair.labels}
    elif mode == "DIFFERENCE":
        options |= {"mode": DIFFERENCE}
    else:
        first = second = first if mode == "A" else second
        options |= {"split": split_of(scene, frame) if settings.wipe else NEVER}
    return Show((region.width, region.height), frame, drawn, first, second, **options)


def _title(scene: bpy.types.Scene, camera: bpy.types.Object, shot: Shot) -> str:
    """Name and state of a shot beside the current one."""
    entry = listed_view.entry_of(scene, camera)
    words = [entry.name if entry is not None else camera.name, status.shown(shot.status), *shot.changes.sentences]
    return ". ".join(filter(None, words))


def words_without_shot(scene: bpy.types.Scene, camera: bpy.types.Object | None) -> str:
    """Why a view shows no picture, by the camera that it looks through, or None; some shot of the scene is open."""
    baked = open_shots.all_of(scene)[0].camera
    if camera is None:
        return f"The relit picture is in the view of camera '{baked}'"
    return listed_view.refusal(scene, camera) or f"No bake for camera '{camera.name}', only for '{baked}'"


def words_without_picture(shot: Shot) -> str:
    """Why an open shot has no picture."""
    if shot.is_seen_beside and shot.status.error:
        return f"The bake of camera '{shot.camera}' cannot be shown: {shot.status.error}"
    return "The first picture is on its way" if shot.is_working else "No picture yet"


def split_of(scene: bpy.types.Scene, frame: Rectangle) -> float:
    """Position of the wipe's line, in pixels of the region."""
    return frame.left + scene.relume_view.wipe_position * frame.width


def draw(content: Show, view: ViewTable) -> None:
    """Draws frames into the overlay texture of a 3D view, which is bound."""
    first, second = texture.of_frame(content.first), texture.of_frame(content.second)
    size = (first.width, first.height)
    snapped = content.frame.snapped(size) if size == (second.width, second.height) else None
    frame = snapped or content.frame
    drawn = frame if content.drawn == content.frame else content.drawn
    compares, has_table = content.mode != SINGLE, view.table is not None
    program = shader.show(snapped is not None, compares, has_table)
    rows = ((*row, 0.0) for row in view.to_rec709.tolist())
    with _state():
        program.shader.bind()
        program.shader.uniform_sampler("first", first)
        program.shader.uniform_sampler("levels", texture.of_levels(view))
        for name, number in (
            ("frame", (frame.left, frame.bottom, frame.right, frame.top)),
            ("drawn", (drawn.left, drawn.bottom, drawn.right, drawn.top)),
            ("region", (*content.region, content.split, content.opacity)),
            ("numbers", (view.scale, view.exponent, content.gain, 0.0)),
            *(() if has_table else zip(shader.ROWS, rows, strict=True)),
        ):
            program.shader.uniform_float(name, number)
        if has_table:
            program.shader.uniform_sampler("table", texture.of_table(view))
            program.shader.uniform_int("has_places", int(view.levels is not None))
        if compares:
            program.shader.uniform_sampler("second", second)
            program.shader.uniform_int("mode", content.mode)
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
