"""Export of the open Blender file to a native scene."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import bpy

from ...export import ExportOptions, export_scene
from ...export.images import texture_size
from ...export.left_out import left_to_blender
from ...export.stop import ExportCancelled, Stop
from ...export.view_layer import render_layer
from ...export.working_space import LINEAR_REC709, working_space
from ..native import native
from ..workers import image_colors
from ..world import worlds
from .render_depsgraph import RenderTask, Work, start_with_render_depsgraph, with_render_depsgraph


def load_scene(scene: bpy.types.Scene, options: ExportOptions | None = None) -> Any:
    """A `relume.Scene` of the present frame, as a final render would see it."""
    return load_scene_for(scene, options)[0]


def load_scene_for(scene: bpy.types.Scene, options: ExportOptions | None) -> tuple[Any, dict[str, str]]:
    """`load_scene`, with descriptions of those of the other cameras of its options that see the very same scene."""
    native()
    others: dict[str, str] = {}
    return with_render_depsgraph(scene, _export(scene, options, others)), others


def load_scene_async(
    scene: bpy.types.Scene,
    options: ExportOptions | None,
    done: Callable[[Any | None, BaseException | None], None],
) -> RenderTask | None:
    """Loads like `load_scene`, without blocking Blender's window. `done` gets the scene or the error, from the event
    loop. The task can be cancelled, also with Esc as any render; the error is `ExportCancelled` then. Without a window
    all is done on return."""
    try:
        if not bpy.app.background:
            native()
            return start_with_render_depsgraph(scene, _export(scene, options), done)
        result = load_scene(scene, options)
    except Exception as error:
        done(None, error)
    else:
        done(result, None)
    return None


def scene_of_depsgraph(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    options: ExportOptions | None,
    stop: Stop,
    notes: Sequence[str] = (),
    others: dict[str, str] | None = None,
) -> Any:
    """A `relume.Scene` of what a render engine was given, with notes among its warnings. The engine shows other frames
    meanwhile, where things move. `others` gets what `export_scene` returns. Raises `ExportCancelled` soon after `stop`
    says so."""

    def frame_set(frame: int, part: float) -> None:
        engine.frame_set(frame, subframe=part)
        if stop():
            raise ExportCancelled("cancelled")

    builder = native().SceneBuilder(working_space())
    for note in notes:
        builder.warn(note)
    if working_space() != LINEAR_REC709:
        builder.warn(f"working space {working_space()}: black bodies keep {LINEAR_REC709} primaries")
    found = export_scene(
        _Stoppable(builder, stop),
        depsgraph,
        options or ExportOptions(),
        lambda world: worlds.rendered(world, texture_size(depsgraph.scene), stop),
        lambda image: image_colors.converted(image, stop),
        frame_set,
    )
    if others is not None:
        others |= found
    return builder.build()


def _export(scene: bpy.types.Scene, options: ExportOptions | None, others: dict[str, str] | None = None) -> Work[Any]:
    """Work that reads a scene and names what is left out. That is found before: the copy that is read has another name
    and other settings."""
    layer = render_layer(scene)
    notes = left_to_blender(scene, layer)
    return lambda engine, depsgraph, stop: scene_of_depsgraph(engine, depsgraph, options, stop, notes, others)


class _Stoppable:
    """A scene builder that may be interrupted before each part."""

    def __init__(self, builder: Any, stop: Stop):
        self._builder, self._stop = builder, stop

    def __getattr__(self, name: str) -> Any:
        if self._stop():
            raise ExportCancelled("cancelled")
        return getattr(self._builder, name)
