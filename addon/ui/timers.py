"""Timers of windows that modal operators wait for. None outlives the add-on: Blender would go on with it for good."""

from __future__ import annotations

import bpy

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


def register():
    """Nothing to add."""


def unregister():
    """Takes all away."""
    for timer in list(_timers):
        end(timer)
