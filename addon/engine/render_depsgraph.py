"""A render-mode depsgraph, which Blender gives only to render engines: modifiers at render levels, objects that are
shown in renders only. A hidden engine is registered around one render and passes its depsgraph on."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from typing import TypeVar

import bpy

Result = TypeVar("Result")


class RelumeExportEngine(bpy.types.RenderEngine):
    """Hands the depsgraph of a final render to `work` and draws nothing."""

    bl_idname = "RELUME_EXPORT"
    bl_label = "Relume (internal)"
    bl_use_preview = False

    work: Callable[[bpy.types.Depsgraph], None] | None = None

    def render(self, depsgraph):
        """Called by Blender, once."""
        work, type(self).work = type(self).work, None
        if work is not None:
            work(depsgraph)


def with_render_depsgraph(scene: bpy.types.Scene, work: Callable[[bpy.types.Depsgraph], Result]) -> Result:
    """The result of `work`, called with the depsgraph of the scene's present frame and first render layer. An
    exception of `work` is raised here: one that left the engine would hang Blender before 5.0."""
    outcome: list[Result] = []
    errors: list[BaseException] = []

    def guarded(depsgraph: bpy.types.Depsgraph) -> None:
        try:
            outcome.append(work(depsgraph))
        except BaseException as error:
            errors.append(error)

    layer = next((layer.name for layer in scene.view_layers if layer.use), scene.view_layers[0].name)
    # A RenderEngine class left registered crashes Blender 4.2 at exit and hangs 4.5.
    bpy.utils.register_class(RelumeExportEngine)
    try:
        with _render_settings(scene):
            RelumeExportEngine.work = guarded
            bpy.ops.render.render(layer=layer, scene=scene.name)
    finally:
        RelumeExportEngine.work = None
        bpy.utils.unregister_class(RelumeExportEngine)
    if errors:
        raise errors[0]
    if not outcome:
        raise RuntimeError(f"Blender did not render scene '{scene.name}'; is a camera set, is a view layer enabled?")
    return outcome[0]


@contextmanager
def _render_settings(scene: bpy.types.Scene):
    """Switches to the hidden engine, without sequencer and compositor, and back."""
    render = scene.render
    wanted = {"engine": RelumeExportEngine.bl_idname, "use_sequencer": False, "use_compositing": False}
    before = {name: getattr(render, name) for name in wanted}
    try:
        for name, value in wanted.items():
            setattr(render, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(render, name, value)
