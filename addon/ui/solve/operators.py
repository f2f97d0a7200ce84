"""Operators that begin to solve, cancel it, and apply the result."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import bpy

from ...apply.writable import RefusedError
from ...core.looks import LookError
from ...core.solve import SolveError
from ...engine.solve import solving
from ...engine.solve.solving import Hooks, Solving
from ...live import rows
from ...live.scheduler import scheduler
from ...viewport import strokes as drawing
from ...viewport.handlers import write
from ...viewport.views import redraw, settle
from .. import looks, timers
from . import results

TICK_SECONDS = 1 / 30
WORDS_SECONDS = 0.5
"""Seconds between drawings of nothing but progress."""
WORDS_POINTS = 36.0
"""Distance of the progress from the upper edge of the picture."""

_handle: Any = None


def begin(scene: bpy.types.Scene) -> Solving:
    """Begins to solve; to be stepped until it ends. Raises SolveError with one line for the artist."""
    shot = solving.ready_shot(scene)
    if own := rows.shots_with_own_values(scene, rows.present_rows(scene)):
        names = ", ".join(f"'{entry.name}'" for entry in own)
        raise SolveError(f"Rows have values of their own in {names}, and solving is about all shots: take them away")
    content = scheduler.content_of(scene, shot)
    before = looks.current(scene, results.BEFORE)
    hooks = Hooks(scheduler.request_picture, scheduler.wake, partial(results.keep, before))
    return solving.begin(scene, shot, content, hooks)


class RELUME_OT_solve(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Find lights that do what was painted. Work goes on meanwhile, Esc cancels; the result is a new look, and the \
lights of the scene stay as they are until it is applied"""

    bl_idname = "relume.solve"
    bl_label = "Solve"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """True unless lights are being solved already."""
        return solving.running(context.scene) is None

    def invoke(self, context, _event):
        """Called by Blender for a button: begins, and goes on by a timer."""
        try:
            self.solving = begin(context.scene)
        except SolveError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.timer = timers.begin(context, TICK_SECONDS)
        context.window_manager.modal_handler_add(self)
        self._show()
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Called by Blender: a step at every tick of the timer; all other events pass through."""
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
            return report_outcome(self, lambda: begin(context.scene).run_to_end())
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
        """True while lights are being solved."""
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
        """True if the active look was solved."""
        look = looks.active_look(context.scene)
        return look is not None and look.solved

    def execute(self, context):
        """Called by Blender."""
        outcome = report_outcome(
            self, lambda: "; ".join(results.apply(context.scene, looks.active_look(context.scene)))
        )
        settle()
        return outcome


def report_outcome(operator: bpy.types.Operator, work: Callable[[], str | None]) -> set[str]:
    """Does an operator's work and reports the words that it returns, or why it failed."""
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
    """Called by Blender for every 3D view, over everything else: progress, whatever the side bar shows."""
    context = bpy.context
    job, frame = solving.running(context.scene), drawing.current_frame_in(context)
    if job is not None and frame is not None:
        top = min(frame.top, context.region.height) - WORDS_POINTS * context.preferences.system.ui_scale
        write(f"{job.progress[1]}   (Esc cancels)", (frame.left + frame.right) / 2, top)


CLASSES = (RELUME_OT_solve, RELUME_OT_cancel_solve, RELUME_OT_apply_solved)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds the operators, and where there is a window the progress over the view."""
    global _handle
    _register()
    bpy.app.handlers.load_pre.append(solving.cancel_all)
    if not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister():
    """Takes them away and ends all jobs."""
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
    _unregister()
    solving.cancel_all()
    bpy.app.handlers.load_pre.remove(solving.cancel_all)
