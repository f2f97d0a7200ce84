"""The operators that begin to solve, end it, and write what came of it."""

from __future__ import annotations

import time
from typing import Any

import bpy

from ..apply.writable import RefusedError
from ..core.looks import LookError
from ..core.solve import SolveError
from ..viewport import strokes as drawing
from ..viewport.handlers import write
from ..viewport.views import redraw, settle
from . import looks, solving, timers

TICK_SECONDS = 1 / 30
WORDS_SECONDS = 0.5
"""Seconds between drawings of nothing but progress."""
WORDS_POINTS = 36.0
"""How far under the upper edge of the picture progress is written."""

_handle: Any = None


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
        self.timer = timers.begin(context, TICK_SECONDS)
        context.window_manager.modal_handler_add(self)
        self._show()
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """A step at every tick of the timer; all else goes on to Blender."""
        if not self.solving.is_running:  # Cancelled by the button, or with its file.
            return self._end({"CANCELLED"})
        if event.type == "ESC" and event.value == "PRESS":
            self.solving.cancel()
            return self._end({"CANCELLED"})
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            goes_on = self.solving.step()
        except SolveError as error:
            self.report({"ERROR"}, str(error))
            return self._end({"CANCELLED"})
        if not goes_on:
            return self._end({"FINISHED"})
        if self.solving.progress != self.shown and time.monotonic() >= self.next_words:
            self._show()
        return {"PASS_THROUGH"}

    def _show(self):
        self.shown, self.next_words = self.solving.progress, time.monotonic() + WORDS_SECONDS
        redraw()
        redraw("UI")

    def cancel(self, _context):
        """Called by Blender when the window closes."""
        self.solving.cancel()
        self._end(set())

    def _end(self, outcome: set[str]) -> set[str]:
        timers.end(self.timer)
        redraw()
        settle()
        return outcome

    def execute(self, context):
        """Called by Blender for Repeat Last and for scripts. Without a window solves to the end; in one it begins an
        operator of its own, as a repeated one is kept by Blender and cannot go on by a timer."""
        if bpy.app.background:
            return told(self, lambda: solving.solve_at_once(context.scene))
        try:
            with context.temp_override(window=context.window or context.window_manager.windows[0]):
                bpy.ops.relume.solve("INVOKE_DEFAULT")
        except RuntimeError as error:
            self.report({"ERROR"}, str(error).strip().removeprefix("Error: "))
            return {"CANCELLED"}
        return {"FINISHED"}


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
    """Write what was solved into the real lights, and make the new ones in the collection "Relume". What was solved \
of the world stays in its row. Strokes and regions are done with and go; the target stays. One undo step"""

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
        outcome = told(self, lambda: "; ".join(solving.apply(context.scene, looks.active_look(context.scene))))
        settle()
        return outcome


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


def _draw() -> None:
    """Called by Blender for every 3D view, over everything else: what is going on, whatever the side bar shows."""
    context = bpy.context
    found, frame = solving.running(context.scene), drawing.frame_in(context)
    if found is not None and frame is not None:
        top = min(frame.top, context.region.height) - WORDS_POINTS * context.preferences.system.ui_scale
        write(f"{found.progress[1]}   (Esc cancels)", (frame.left + frame.right) / 2, top)


CLASSES = (RELUME_OT_solve, RELUME_OT_cancel_solve, RELUME_OT_apply_solved)


def register():
    """Adds the operators, and where there is a window what tells of them."""
    global _handle
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister():
    """Takes them away."""
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
