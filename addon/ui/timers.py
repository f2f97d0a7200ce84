"""Timers of windows that modal operators wait for. None outlives the add-on: Blender would go on with it for good."""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import Any

import bpy

POLL_SECONDS = 0.05
SCRIPT_POLL_SECONDS = 0.01
"""Poll interval where a script waits."""

_timers: list[bpy.types.Timer] = []


def begin(context: bpy.types.Context, seconds: float) -> bpy.types.Timer:
    """A timer of the present window."""
    timer = context.window_manager.event_timer_add(seconds, window=context.window)
    _timers.append(timer)
    return timer


def end(timer: bpy.types.Timer) -> None:
    """Takes a timer away, if it is there still."""
    if timer in _timers:
        _timers.remove(timer)
        bpy.context.window_manager.event_timer_remove(timer)


class WaitingOperator:
    """Mix-in of operators whose function yields until what it waits for is there. In a window a timer goes on with it;
    a script's call waits for the end."""

    failures: tuple[type[Exception], ...] = ()
    """Exceptions that are told to the artist."""

    def work(self, context: bpy.types.Context) -> Generator[None, None, str | None]:
        """The function that the operator stands for; what it returns is told."""
        raise NotImplementedError

    def invoke(self: Any, context, _event):
        """Called by Blender for a button."""
        self.begun = self.work(context)
        self.timer = begin(context, POLL_SECONDS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self: Any, _context, event):
        """Called by Blender."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        outcome = self._step(self.begun)
        if outcome is None:
            return {"PASS_THROUGH"}
        end(self.timer)
        return outcome

    def cancel(self: Any, _context):
        """Called by Blender when the window closes."""
        self.begun.close()
        end(self.timer)

    def execute(self: Any, context):
        """Called by Blender for scripts and for Repeat Last."""
        begun = self.work(context)
        while (outcome := self._step(begun)) is None:
            time.sleep(SCRIPT_POLL_SECONDS)
        return outcome

    def _step(self: Any, begun: Generator[None, None, str | None]) -> set[str] | None:
        """Goes on for a moment; how the operator ends, if it does."""
        try:
            next(begun)
            return None
        except StopIteration as stop:
            if stop.value:
                self.report({"INFO"}, stop.value)
            return {"FINISHED"}
        except self.failures as error:
            self.report({"ERROR"}, " ".join(str(error).split()))
            return {"CANCELLED"}


def register():
    """Nothing to add."""


def unregister():
    """Takes all away."""
    for timer in list(_timers):
        end(timer)
