"""The panel of solving, and the operators that begin it, end it, and write what came of it."""

from __future__ import annotations

import json
import time
from typing import Any

import bpy

from ..apply.writable import RefusedError
from ..core.looks import LookError
from ..core.solve import SolveError
from . import locks, looks, regions, scribble_tool, solving, target
from .panel import RelumePanel, message
from .solve_settings import strokes_of

TICK_SECONDS = 1 / 30


class RELUME_OT_solve(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Find lights that do what was painted. Work goes on meanwhile, Esc cancels; the result is a new look, and the \
lights of the scene stay as they are until it is applied"""

    bl_idname = "relume.solve"
    bl_label = "Solve"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Not while it is solving already."""
        return solving.running(context.scene) is None

    def invoke(self, context, _event):
        """Begins, and goes on by a timer."""
        try:
            self.solving = solving.begin(context.scene)
        except SolveError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        manager = context.window_manager
        self.timer = manager.event_timer_add(TICK_SECONDS, window=context.window)
        manager.modal_handler_add(self)
        _redraw(context)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """A step at every tick of the timer; all else goes on to Blender."""
        if solving.running(context.scene) is not self.solving:  # Cancelled by the button, or with its file.
            return self._end(context, {"CANCELLED"})
        if event.type == "ESC" and event.value == "PRESS":
            self.solving.cancel()
            return self._end(context, {"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        before = self.solving.progress
        try:
            goes_on = self.solving.step()
        except SolveError as error:
            self.report({"ERROR"}, str(error))
            return self._end(context, {"CANCELLED"})
        if not goes_on:
            return self._end(context, {"FINISHED"})
        if self.solving.progress != before:
            _redraw(context)
        return {"PASS_THROUGH"}

    def cancel(self, context):
        """Called by Blender when the window closes."""
        self.solving.cancel()
        self._end(context, set())

    def _end(self, context, outcome: set[str]) -> set[str]:
        context.window_manager.event_timer_remove(self.timer)
        _redraw(context)
        return outcome

    def execute(self, context):
        """Without a window: solves to the end."""
        return told(self, lambda: _solve_at_once(context.scene))


class RELUME_OT_cancel_solve(bpy.types.Operator):  # noqa: N801
    """End solving; nothing has been changed"""

    bl_idname = "relume.cancel_solve"
    bl_label = "Cancel Solving"

    @classmethod
    def poll(cls, context):
        """Only while solving."""
        return solving.running(context.scene) is not None

    def execute(self, context):
        """Called by Blender."""
        solving.running(context.scene).cancel()
        return {"FINISHED"}


class RELUME_OT_apply_solved(bpy.types.Operator):  # noqa: N801
    """Write what was solved into the real lights, and make the new ones in the collection "Relume". One undo step"""

    bl_idname = "relume.apply_solved"
    bl_label = "Apply Solved Lights"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Only with a look that was solved."""
        look = looks.active_look(context.scene)
        return look is not None and look.solved

    def execute(self, context):
        """Called by Blender."""
        return told(self, lambda: str(solving.apply(context.scene, looks.active_look(context.scene))))


def told(operator: bpy.types.Operator, work: Any) -> set[str]:
    """Does an operator's work; what keeps it from being done, and what else came of it, is said."""
    try:
        words = work()
    except RefusedError as error:
        for reason in error.reasons:
            operator.report({"ERROR"}, f"Nothing was written: {reason}")
        return {"CANCELLED"}
    except (SolveError, LookError) as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    if words:
        operator.report({"WARNING"}, words)
    return {"FINISHED"}


def _solve_at_once(scene: bpy.types.Scene) -> None:
    found = solving.begin(scene)
    while found.step():
        found.shot.poll()
        time.sleep(TICK_SECONDS)


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "UI":
                        region.tag_redraw()


class RELUME_PT_solve(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Lights that solve themselves"""

    bl_idname = "RELUME_PT_solve"
    bl_label = "Solve"
    bl_order = 15

    def draw(self, context):
        """Called by Blender."""
        layout, scene = self.layout, context.scene
        settings = scene.relume_solve
        line = layout.row(align=True)
        line.operator("relume.pick_brush", icon="BRUSH_DATA")
        scribble_tool.draw_brush(line, settings)
        strokes = strokes_of(scene)
        if strokes:
            line = layout.row(align=True)
            line.label(text="1 stroke" if len(strokes) == 1 else f"{len(strokes)} strokes")
            line.prop(settings, "show_strokes", text="", icon="HIDE_OFF" if settings.show_strokes else "HIDE_ON")
            line.operator("relume.clear_strokes", text="", icon="TRASH")
        regions.draw(layout, scene)
        _draw_start(layout, scene)
        if settings.report:
            _draw_report(layout, scene)


class RELUME_PT_solve_target(RelumePanel, bpy.types.Panel):  # noqa: N801
    """A picture to come close to"""

    bl_idname = "RELUME_PT_solve_target"
    bl_label = "Target Picture"
    bl_parent_id = "RELUME_PT_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        target.draw(self.layout, context.scene)


class RELUME_PT_solve_locks(RelumePanel, bpy.types.Panel):  # noqa: N801
    """What solving may change, and how hard it tries"""

    bl_idname = "RELUME_PT_solve_locks"
    bl_label = "What May Change"
    bl_parent_id = "RELUME_PT_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, settings = self.layout, context.scene.relume_solve
        locks.draw(layout, context.scene)
        line = layout.row(align=True)
        line.prop(settings, "add_count")
        if settings.add_count:
            line.prop(settings, "add_type", text="")
        layout.prop(settings, "remove")
        layout.prop(settings, "keep_rest", slider=True)
        layout.prop(settings, "effort")


def _draw_start(layout, scene: bpy.types.Scene) -> None:
    found = solving.running(scene)
    if found is not None:
        share, text = found.progress
        layout.progress(factor=share, text=text)
        layout.operator("relume.cancel_solve", icon="X")
        return
    line = layout.row()
    line.scale_y = 1.5
    line.operator("relume.solve", icon="LIGHT")


def _draw_report(layout, scene: bpy.types.Scene) -> None:
    report, box = json.loads(scene.relume_solve.report), layout.box()
    box.label(text=report["look"])
    for line in report["lines"]:
        message(box, line["text"], "CHECKMARK" if line["met"] else "ERROR")
    for note in report["notes"]:
        message(box, note, "INFO")
    look = looks.active_look(scene)
    if look is not None and look.solved:
        line = box.row(align=True)
        line.operator("relume.apply_solved", text=f"Apply {look.name}", icon="CHECKMARK")


CLASSES = (
    RELUME_OT_solve,
    RELUME_OT_cancel_solve,
    RELUME_OT_apply_solved,
    RELUME_PT_solve,
    RELUME_PT_solve_target,
    RELUME_PT_solve_locks,
)


def register():
    """Adds panels and operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
