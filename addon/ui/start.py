"""The main panel: one button, what is being done, what is shown."""

from __future__ import annotations

import bpy

from ..core import status
from ..engine import shot
from ..engine.checks import ProblemError, check_start
from ..engine.native import NativeModuleError
from . import handlers
from .panel import RelumePanel, message


def start(scene: bpy.types.Scene) -> shot.Shot:
    """Bakes the scene and shows it under its present lights. Raises ProblemError with one line for the artist."""
    check_start(scene)
    found = shot.Shot.start(scene)
    scene.relume.baked_folder = bpy.path.relpath(str(found.folder)) if bpy.data.filepath else str(found.folder)
    handlers.read_lights(scene)
    handlers.wake()
    return found


class ShotOperator:
    """Mix-in of operators that need an open shot."""

    @classmethod
    def poll(cls, context):
        """Only with an open shot."""
        return shot.of(context.scene) is not None


class RELUME_OT_start(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Trace the paths of the camera view once, then relight it live while the lights are edited"""

    bl_idname = "relume.start"
    bl_label = "Start"

    def execute(self, context):
        """Called by Blender."""
        try:
            start(context.scene)
        except (ProblemError, NativeModuleError, RuntimeError, ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_pause(ShotOperator, bpy.types.Operator):  # noqa: N801
    """Let tracing and learning stand still, for example while you need the processor; press again to go on"""

    bl_idname = "relume.pause"
    bl_label = "Pause"

    def execute(self, context):
        """Called by Blender."""
        found = shot.of(context.scene)
        found.pause(not found.status["paused"])
        handlers.wake()
        return {"FINISHED"}


class RELUME_OT_cancel(ShotOperator, bpy.types.Operator):  # noqa: N801
    """End tracing and learning; what is there is kept and relighting goes on"""

    bl_idname = "relume.cancel"
    bl_label = "Cancel"

    def execute(self, context):
        """Called by Blender."""
        shot.of(context.scene).cancel()
        handlers.wake()
        return {"FINISHED"}


class RELUME_OT_look_through_camera(bpy.types.Operator):  # noqa: N801
    """Switch this view to the scene's camera, where the relit picture is shown"""

    bl_idname = "relume.look_through_camera"
    bl_label = "Look Through Camera"

    @classmethod
    def poll(cls, context):
        """Only in a 3D view with a camera."""
        return context.scene.camera is not None and context.region_data is not None

    def execute(self, context):
        """Called by Blender."""
        context.region_data.view_perspective = "CAMERA"
        return {"FINISHED"}


class RELUME_PT_start(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Start, progress, and what is shown"""

    bl_idname = "RELUME_PT_start"
    bl_label = "Relume"
    bl_order = 0

    def draw(self, context):
        """Called by Blender."""
        layout, found = self.layout, shot.of(context.scene)
        if context.region_data is not None and context.region_data.view_perspective != "CAMERA":
            layout.operator("relume.look_through_camera", icon="OUTLINER_DATA_CAMERA")
        if found is None or not found.is_working:
            _draw_start(layout, context.scene, found)
        if found is not None:
            _draw_state(layout, found)


def _draw_start(layout, scene, found) -> None:
    column = layout.column()
    column.prop(scene.relume, "quality")
    if scene.relume.quality == "CUSTOM":
        column.prop(scene.relume, "samples")
    column.prop(scene.relume, "folder", text="Folder")
    row = column.row()
    row.scale_y = 1.5
    row.operator("relume.start", text="Rebake" if found else "Start", icon="PLAY")


def _draw_state(layout, found) -> None:
    state = found.status
    message(layout, status.headline(state), icon="ERROR" if state["state"] == "failed" else "NONE")
    progress = status.progress(state)
    if progress is not None:
        layout.progress(factor=progress[0], text=progress[1])
        row = layout.row(align=True)
        paused = state["paused"]
        row.operator("relume.pause", text="Resume" if paused else "Pause", icon="PLAY" if paused else "PAUSE")
        row.operator("relume.cancel", icon="X")
    if status.shown(state):
        message(layout, status.shown(state))


CLASSES = (RELUME_OT_start, RELUME_OT_pause, RELUME_OT_cancel, RELUME_OT_look_through_camera, RELUME_PT_start)


def register():
    """Adds panel and operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
