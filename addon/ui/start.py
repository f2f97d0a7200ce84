"""Start, pause, cancel, and finding a bake again: operators over functions that a script can call as well."""

from collections.abc import Callable
from pathlib import Path

import bpy
from bpy.props import BoolProperty, StringProperty

from ..core.bake_folder import is_bake
from ..core.status import has_failed
from ..engine.native import NativeModuleError
from ..engine.shot import shot
from ..engine.shot.checks import ProblemError, check_start
from ..engine.shot.options import Options, bake_folder, remember_bake, remembered_bake
from ..live.scheduler import scheduler

FAILURES = (ProblemError, NativeModuleError, RuntimeError, ValueError, OSError)
"""Exceptions that are told to the artist instead of shown as a fault of the program."""


def start(scene: bpy.types.Scene, anew: bool = False, options: Options | None = None) -> shot.Shot:
    """Bakes the scene and shows it under its present lights; `anew` and `options` are as of `Shot.start`. Raises
    ProblemError with one line for the artist."""
    check_start(scene, options.folder if options else None)
    found = shot.Shot.start(scene, anew, options)
    if has_failed(found.status):  # Without a window the scene is read at once.
        found.close()
        raise ProblemError(found.status.error)
    scheduler.read_lights(scene)
    scheduler.wake()
    return found


def go_on(scene: bpy.types.Scene) -> shot.Shot:
    """Does what the open bake still lacks of what was asked for when it was started. Raises ProblemError."""
    found = shot.of(scene)
    if found is None:
        raise ProblemError("No bake is open; show it, or start again")
    return start(scene, options=found.resume_options(scene))


def open_bake(scene: bpy.types.Scene) -> shot.Shot:
    """Shows the bake of a scene under its present lights."""
    opened = shot.Shot.open(scene)
    scheduler.read_lights(scene)
    return opened


def show_bake(scene: bpy.types.Scene) -> shot.Shot:
    """Opens the bake that the file remembers, or that its folder holds, and shows it under the present lights."""
    folder = remembered_bake(scene) or bake_folder(scene)
    if not is_bake(folder):
        raise ProblemError(f"There is no bake in '{folder}'; find it, or start again")
    return open_bake(scene)


def find_bake(scene: bpy.types.Scene, folder: Path) -> shot.Shot:
    """Takes a bake that was moved."""
    if not is_bake(folder):
        raise ProblemError(f"'{folder}' is no bake of Relume; choose the folder with its manifest.json")
    remember_bake(scene, folder)
    return open_bake(scene)


def toggle_pause(scene: bpy.types.Scene) -> None:
    """Lets the tracing and learning of an open shot stand still, or go on."""
    found = shot.of(scene)
    if found is not None:
        found.pause(not found.status.live.paused)
        scheduler.wake()


def cancel(scene: bpy.types.Scene) -> None:
    """Ends the tracing and learning of an open shot; relighting goes on."""
    found = shot.of(scene)
    if found is not None:
        found.cancel()
        scheduler.wake()


class ShotOperator:
    """Mix-in of operators that need an open shot."""

    @classmethod
    def poll(cls, context):
        """Only with an open shot."""
        return shot.of(context.scene) is not None


def report_failures(operator: bpy.types.Operator, work: Callable[[], object]) -> set[str]:
    """Does an operator's work; what keeps it from being done is said in one line."""
    try:
        work()
    except FAILURES as error:
        operator.report({"ERROR"}, " ".join(str(error).split()))
        return {"CANCELLED"}
    return {"FINISHED"}


class RELUME_OT_start(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Trace the paths of the camera view once, then relight it live while the lights are edited"""

    bl_idname = "relume.start"
    bl_label = "Start"

    def execute(self, context):
        """Called by Blender."""
        return report_failures(self, lambda: start(context.scene))


class RELUME_OT_go_on(ShotOperator, bpy.types.Operator):  # noqa: N801
    """Trace and learn what the stopped bake still lacks, with the quality that it was started with"""

    bl_idname = "relume.go_on"
    bl_label = "Resume"

    def execute(self, context):
        """Called by Blender."""
        return report_failures(self, lambda: go_on(context.scene))


class RELUME_OT_rebake(bpy.types.Operator):  # noqa: N801
    """Trace the paths again where the scene has changed, or where lights have moved away from where the paths look"""

    bl_idname = "relume.rebake"
    bl_label = "Rebake"

    def execute(self, context):
        """Called by Blender."""
        return report_failures(self, lambda: start(context.scene, anew=True))


class RELUME_OT_show_bake(bpy.types.Operator):  # noqa: N801
    """Show the stored bake of this scene under its present lights, without tracing again"""

    bl_idname = "relume.show_bake"
    bl_label = "Show Bake"

    def execute(self, context):
        """Called by Blender."""
        return report_failures(self, lambda: show_bake(context.scene))


class RELUME_OT_find_bake(bpy.types.Operator):  # noqa: N801
    """Choose the folder of this scene's bake, where it was moved to"""

    bl_idname = "relume.find_bake"
    bl_label = "Find Bake"

    directory: StringProperty(name="Folder", description="Folder of the bake", subtype="DIR_PATH")
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context, _event):
        """Called by Blender."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        """Called by Blender."""
        return report_failures(self, lambda: find_bake(context.scene, Path(self.directory)))


class RELUME_OT_pause(ShotOperator, bpy.types.Operator):  # noqa: N801
    """Let tracing and learning stand still, for example while you need the processor; press again to go on"""

    bl_idname = "relume.pause"
    bl_label = "Pause"

    def execute(self, context):
        """Called by Blender."""
        toggle_pause(context.scene)
        return {"FINISHED"}


class RELUME_OT_cancel(ShotOperator, bpy.types.Operator):  # noqa: N801
    """End tracing and learning; what is there is kept and relighting goes on"""

    bl_idname = "relume.cancel"
    bl_label = "Cancel"

    def execute(self, context):
        """Called by Blender."""
        cancel(context.scene)
        return {"FINISHED"}


class RELUME_OT_look_through_camera(bpy.types.Operator):  # noqa: N801
    """Switch this view to the scene's camera, where the relit picture is shown"""

    bl_idname = "relume.look_through_camera"
    bl_label = "Look Through Camera"

    @classmethod
    def poll(cls, context):
        """Only in a 3D view with a camera."""
        return context.scene.camera is not None and context.area is not None and context.area.type == "VIEW_3D"

    def execute(self, context):
        """Called by Blender."""
        context.space_data.region_3d.view_perspective = "CAMERA"  # A side bar has no region_data.
        return {"FINISHED"}


CLASSES = (
    RELUME_OT_start,
    RELUME_OT_go_on,
    RELUME_OT_rebake,
    RELUME_OT_show_bake,
    RELUME_OT_find_bake,
    RELUME_OT_pause,
    RELUME_OT_cancel,
    RELUME_OT_look_through_camera,
)


def register():
    """Adds the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
