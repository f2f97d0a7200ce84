"""Draw handlers of all 3D views, and the timer that bakes view tables.

The picture goes over the scene and under the gizmos (POST_VIEW), the words over everything (POST_PIXEL). A view table
that is not there yet is never waited for: the timer has it made, and asks for a redraw.
"""

from __future__ import annotations

from typing import Any

import blf
import bpy
import gpu
from bpy.app.handlers import persistent
from gpu_extras.batch import batch_for_shader

from ..engine.shot import shot as shots
from ..engine.workers import view_worker
from . import compare, light_marks, overlay, texture, view_files, view_table
from .overlay import Show
from .view_files import NEXT_TURN_SECONDS
from .views import redraw

WORDS_POINTS = 11.0
MARGIN_POINTS = 14.0
RETRY_SECONDS = 5.0

_handles: list[Any] = []
_waiting: set[int] = set()
"""Scenes whose view table or file is not made yet."""
_trouble: dict[int, str] = {}
"""Why the view table of a scene cannot be made, in words for the artist."""


def prepare(scene: bpy.types.Scene) -> None:
    """Has the view table made that the first picture of a scene will need; costs nothing if there is one."""
    if view_table.of(scene) is None:
        _waiting.add(scene.session_uid)
        wake()


def draw_picture() -> None:
    """Called by Blender for every 3D view, after the scene and before the gizmos."""
    context = bpy.context
    scene, region = context.scene, context.region
    texture.keep_only([*(picture for shot in shots.all_open() for picture in shot.pictures), *compare.frames()])
    what = overlay.what_to_show(scene, context.space_data, region, context.region_data)
    if not isinstance(what, Show):
        if what is not None:
            prepare(scene)
        return
    if not (view_table.is_complete(scene) and _has_file(scene)):
        _waiting.add(scene.session_uid)
        wake()
    view = view_table.of(scene)
    if view is not None:
        overlay.draw(what, view)


def draw_words() -> None:
    """Called by Blender for every 3D view, after everything else."""
    context = bpy.context
    scene, region = context.scene, context.region
    what = overlay.what_to_show(scene, context.space_data, region, context.region_data)
    hint = _trouble.get(scene.session_uid)
    if not isinstance(what, Show):
        hint = what if context.space_data.overlay.show_overlays else None
    else:
        light_marks.draw(context, what, _scale())
        if what.title and not hint and context.space_data.overlay.show_overlays:
            write(what.title, region.width / 2, MARGIN_POINTS * _scale())
        if what.split != overlay.NEVER:
            _draw_split(what)
    if hint:
        write(f"Relume: {hint}", region.width / 2, MARGIN_POINTS * _scale())


def wake() -> None:
    """Starts the timer; it ends by itself."""
    if not bpy.app.background and not bpy.app.timers.is_registered(bake_views):
        bpy.app.timers.register(bake_views, first_interval=0.0)


def bake_views() -> float | None:
    """A turn of having the view table made of a scene that waits for one, then the file beside its bake; seconds until
    the next turn."""
    better, pause = False, NEXT_TURN_SECONDS
    for scene in bpy.data.scenes:
        if scene.session_uid not in _waiting:
            continue
        try:
            better |= view_table.work(scene)
            pause = _work_on_file(scene)
            _trouble.pop(scene.session_uid, None)
        except (OSError, RuntimeError) as error:
            _trouble[scene.session_uid], pause = str(error), RETRY_SECONDS
        if view_table.is_complete(scene) and _has_file(scene):
            _waiting.discard(scene.session_uid)
        elif pause != RETRY_SECONDS:
            break  # Views are coloured one after another.
    if better or pause == RETRY_SECONDS:
        redraw()
    _waiting.intersection_update({scene.session_uid for scene in bpy.data.scenes})
    return pause if _waiting else None


def _has_file(scene: bpy.types.Scene) -> bool:
    shot = shots.of(scene)
    return shot is None or view_files.is_done(shot, scene)


def _work_on_file(scene: bpy.types.Scene) -> float:
    """Seconds until the next turn."""
    shot = shots.of(scene)
    if shot is None or not view_table.is_complete(scene) or view_files.is_done(shot, scene):
        return NEXT_TURN_SECONDS
    return view_files.work(shot, scene)


def register() -> None:
    """Adds the handlers, where there is a window to draw into."""
    bpy.app.handlers.load_pre.append(_forget)
    if bpy.app.background:
        return
    for draw, when in ((draw_picture, "POST_VIEW"), (draw_words, "POST_PIXEL")):
        _handles.append(bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", when))


def unregister() -> None:
    """Removes everything and frees the graphics card's memory."""
    while _handles:
        bpy.types.SpaceView3D.draw_handler_remove(_handles.pop(), "WINDOW")
    bpy.app.handlers.load_pre.remove(_forget)
    if bpy.app.timers.is_registered(bake_views):
        bpy.app.timers.unregister(bake_views)
    _forget()
    view_worker.shared().drop()
    view_table.clear()
    texture.free()
    if not bpy.app.background:
        redraw()


@persistent
def _forget(*_arguments) -> None:
    """Forgets all of the present file when another one is about to be opened."""
    compare.free()
    _waiting.clear()
    _trouble.clear()


def _draw_split(what: Show) -> None:
    left, right = what.labels
    bottom, top = max(what.drawn.bottom, 0.0), min(what.drawn.top, what.region[1])
    line = gpu.shader.from_builtin("UNIFORM_COLOR")
    for offset, color in ((0.0, (0.0, 0.0, 0.0, 0.6)), (1.0, (1.0, 1.0, 1.0, 0.8))):
        ends = [(what.split + offset, bottom), (what.split + offset, top)]
        batch = batch_for_shader(line, "LINES", {"pos": ends})
        blend = gpu.state.blend_get()
        gpu.state.blend_set("ALPHA")
        line.uniform_float("color", color)
        batch.draw(line)
        gpu.state.blend_set(blend)
    gap = MARGIN_POINTS * _scale()
    write(left, what.split - 2.5 * gap, bottom + gap)
    write(right, what.split + 2.5 * gap, bottom + gap)


def write(text: str, center: float, bottom: float) -> None:
    """Words over everything, around a place in pixels of the region that is drawn."""
    font = 0
    blf.size(font, WORDS_POINTS * _scale())
    blf.color(font, 1.0, 1.0, 1.0, 0.9)
    blf.enable(font, blf.SHADOW)
    blf.shadow(font, 3, 0.0, 0.0, 0.0, 0.8)
    blf.position(font, center - blf.dimensions(font, text)[0] / 2, bottom, 0.0)
    blf.draw(font, text)
    blf.disable(font, blf.SHADOW)


def _scale() -> float:
    return bpy.context.preferences.system.ui_scale
