"""Operators on the list of shots, over functions that a script can call as well."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty

from ...engine.shot import shot_list
from ...engine.shot.background import BackgroundError
from ...engine.shot.checks import ProblemError
from ...engine.workers.process import NoCopyError
from ...export.current_shot import active_entry
from ...live import follow, rows
from ...live.scheduler import scheduler
from . import baking

PROBLEMS = (ProblemError, BackgroundError, NoCopyError, ValueError, OSError)


def take(scene: bpy.types.Scene, added: list[Any]) -> None:
    """Chooses the first of the shots that were added; one of them may be what is open."""
    follow.adopt(scene)
    scene.relume_shots.active = len(scene.relume_shots.items) - len(added)


def remove(scene: bpy.types.Scene) -> None:
    """Takes the chosen shot off the list."""
    state = scene.relume_shots
    number = state.active
    state.items.remove(number)
    rows.drop_gone_shots(scene)
    scheduler.request_picture(scene)
    state.active = max(0, min(number, len(state.items) - 1))


def move(scene: bpy.types.Scene, steps: int) -> bool:
    """Moves the chosen shot down the list, or up; False at the end of it."""
    state = scene.relume_shots
    place = state.active + steps
    if not 0 <= place < len(state.items):
        return False
    state.items.move(state.active, place)
    state.active = place
    return True


class _OnShot:
    """Mix-in of operators on the chosen shot."""

    @classmethod
    def poll(cls, context):
        """True if a shot is chosen."""
        return active_entry(context.scene) is not None


def _added(operator: bpy.types.Operator, scene: bpy.types.Scene, found: list[Any], none: str) -> set[str]:
    if not found:
        operator.report({"INFO"}, none)
        return {"CANCELLED"}
    take(scene, found)
    return {"FINISHED"}


class RELUME_OT_add_cameras(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Add a shot for each camera of the scene that has none yet"""

    bl_idname = "relume.add_cameras"
    bl_label = "Add Cameras"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        scene = context.scene
        return _added(self, scene, shot_list.add_cameras(scene), "Every camera of the scene has a shot already")


class RELUME_OT_add_from_markers(bpy.types.Operator):  # noqa: N801
    """Add a shot for each marker of the timeline that a camera is bound to, at its frame"""

    bl_idname = "relume.add_from_markers"
    bl_label = "Add from Markers"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        scene = context.scene
        none = "No marker has a camera that is not listed yet; bind one with Ctrl+B in the timeline"
        return _added(self, scene, shot_list.add_from_markers(scene), none)


class RELUME_OT_add_view_layers(bpy.types.Operator):  # noqa: N801
    """Add a shot of the scene's camera for each view layer that is rendered and has none yet"""

    bl_idname = "relume.add_view_layers"
    bl_label = "Add View Layers"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        scene = context.scene
        if scene.camera is None:
            self.report({"ERROR"}, "The scene has no camera; choose one")
            return {"CANCELLED"}
        none = "Every view layer that is rendered has a shot of this camera already"
        return _added(self, scene, shot_list.add_view_layers(scene), none)


class RELUME_OT_add_bake(bpy.types.Operator):  # noqa: N801
    """Add the bake of another scene or file. It is relit with the others on the contact sheet, and never written to"""

    bl_idname = "relume.add_bake"
    bl_label = "Add Bake"
    bl_options = {"REGISTER", "UNDO"}

    directory: StringProperty(name="Folder", description="Folder of the bake", subtype="DIR_PATH")
    filter_folder: BoolProperty(default=True, options={"HIDDEN"})

    def invoke(self, context, _event):
        """Called by Blender."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        """Called by Blender."""
        try:
            entry = shot_list.add_bake(context.scene, Path(self.directory))
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return _added(self, context.scene, [entry], "")


class RELUME_OT_remove_shot(_OnShot, bpy.types.Operator):  # noqa: N801
    """Take the chosen shot off the list. Its bake stays"""

    bl_idname = "relume.remove_shot"
    bl_label = "Remove Shot"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        remove(context.scene)
        return {"FINISHED"}


class RELUME_OT_move_shot(_OnShot, bpy.types.Operator):  # noqa: N801
    """Move the chosen shot up or down the list"""

    bl_idname = "relume.move_shot"
    bl_label = "Move Shot"
    bl_options = {"REGISTER", "UNDO"}

    direction: EnumProperty(
        name="Direction",
        description="Where to",
        items=[("UP", "Up", "Towards the top of the list"), ("DOWN", "Down", "Towards the end of the list")],
    )

    def execute(self, context):
        """Called by Blender."""
        return {"FINISHED"} if move(context.scene, 1 if self.direction == "DOWN" else -1) else {"CANCELLED"}


class RELUME_OT_bake_all(bpy.types.Operator):  # noqa: N801
    """Trace and learn all shots that are on, one after the other, in a Blender of its own: you can go on working.
    Interrupted bakes go on"""

    bl_idname = "relume.bake_all"
    bl_label = "Bake All"

    @classmethod
    def poll(cls, context):
        """True if there is a list, and none of it is being baked."""
        scene = context.scene
        return len(scene.relume_shots.items) > 0 and not baking.is_running(scene)

    def execute(self, context):
        """Called by Blender."""
        try:
            batch = baking.bake_all(context.scene)
        except PROBLEMS as error:
            self.report({"ERROR"}, " ".join(str(error).split()))
            return {"CANCELLED"}
        if batch.failures:
            self.report({"WARNING"}, f"Not baked: {baking.words_of(batch.failures)}")
        return {"FINISHED"}


class RELUME_OT_stop_baking(bpy.types.Operator):  # noqa: N801
    """Stop the bake of the present shot, and leave those out that wait. What is written stays, and the next start goes
    on from there"""

    bl_idname = "relume.stop_baking"
    bl_label = "Stop Baking"

    @classmethod
    def poll(cls, context):
        """True while shots are baked."""
        return baking.is_running(context.scene)

    def execute(self, context):
        """Called by Blender."""
        baking.stop(context.scene)
        return {"FINISHED"}


CLASSES = (
    RELUME_OT_add_cameras,
    RELUME_OT_add_from_markers,
    RELUME_OT_add_view_layers,
    RELUME_OT_add_bake,
    RELUME_OT_remove_shot,
    RELUME_OT_move_shot,
    RELUME_OT_bake_all,
    RELUME_OT_stop_baking,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
