"""The viewport's shading "Rendered" of Relume's render engine: the newest picture in the camera's frame, scene-linear;
Blender itself makes display colours of it. Nothing is computed here."""

from __future__ import annotations

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ..core.pass_names import COMBINED
from ..engine.shot import open_shots
from ..engine.shot.shot import Shot
from . import camera_frame, overlay, texture
from .camera_frame import Rectangle

TEXT_SIZE, TEXT_MARGIN, TEXT_COLOR = 14.0, 20.0, (0.7, 0.7, 0.7, 1.0)
TOO_EARLY = "The whole picture: this view's pass is shown when all paths are traced"


def draw(engine: bpy.types.RenderEngine, context: bpy.types.Context, name: str = COMBINED) -> bool:
    """Body of `RenderEngine.view_draw`: draws a pass by its name. False if the picture stands in for it, as there is
    none of the pass yet."""
    scene, region = context.scene, context.region
    camera = camera_frame.camera_of(scene, context.space_data)
    frame = camera_frame.frame_of(scene, camera, region, context.region_data)
    shot = open_shots.showing(scene, camera) if frame is not None else None
    words = why_not(scene, shot, camera if frame is not None else None)
    if words:
        _write(words, region, region.height / 2)
        return True
    assert shot is not None and frame is not None
    picture = texture.of_frame(shot.picture_of(name))
    place = frame.snapped((picture.width, picture.height)) or frame
    low, high = camera_frame.border_of(scene)
    blend = gpu.state.blend_get()
    gpu.state.blend_set("ALPHA_PREMULT")
    engine.bind_display_space_shader(scene)
    try:
        _draw_part(picture, place, Rectangle(*low, *high))
    finally:
        engine.unbind_display_space_shader()
        gpu.state.blend_set(blend)
    is_there = name == COMBINED or shot.picture_of(name) is not shot.picture
    if not is_there and shot.is_tracing:
        _write(TOO_EARLY, region, TEXT_MARGIN)
    return is_there


def _draw_part(picture: gpu.types.GPUTexture, place: Rectangle, part: Rectangle) -> None:
    """Draws a part of a picture, given in fractions of it, where it belongs if the whole is in `place`."""
    shader = gpu.shader.from_builtin("IMAGE")
    corners = [(x, y) for y in (part.bottom, part.top) for x in (part.left, part.right)]
    batch = batch_for_shader(shader, "TRI_STRIP", {"pos": corners, "texCoord": corners})
    with gpu.matrix.push_pop():
        gpu.matrix.translate((place.left, place.bottom))
        gpu.matrix.scale((place.width, place.height))
        shader.uniform_sampler("image", picture)
        batch.draw(shader)


def why_not(scene: bpy.types.Scene, shot: Shot | None, camera: bpy.types.Object | None) -> str:
    """Reason why there is nothing to draw for a view through a camera, or none; empty if its shot has a picture."""
    if not open_shots.all_of(scene):
        return 'Press Start in the sidebar\'s tab "Relume" to see the relit picture here'
    if shot is None:
        return overlay.words_without_shot(scene, camera)
    return "" if shot.picture is not None else overlay.words_without_picture(shot)


def _write(words: str, region: bpy.types.Region, bottom: float) -> None:
    blf.size(0, TEXT_SIZE * bpy.context.preferences.system.ui_scale)
    blf.color(0, *TEXT_COLOR)
    blf.position(0, (region.width - blf.dimensions(0, words)[0]) / 2, bottom, 0.0)
    blf.draw(0, words)
