"""Calls of the add-on's Python code by Blender, by the clock: timers, handlers, operators, drawing."""

import sys
import threading
import time

import bpy

TOOL = sys.monitoring.PROFILER_ID


class Calls:
    """Context in which calls are noted in `found`, seconds and name of each. Those inside of others belong to the
    outermost one; those on other threads are not noted."""

    def __init__(self):
        self.found = []
        self._folder = bpy.utils.user_resource("EXTENSIONS")
        self._frame, self._begun = None, 0.0

    def __enter__(self):
        events = sys.monitoring.events
        sys.monitoring.use_tool_id(TOOL, "relume window tests")
        sys.monitoring.register_callback(TOOL, events.PY_START, self._begin)
        for event in (events.PY_RETURN, events.PY_UNWIND):
            sys.monitoring.register_callback(TOOL, event, self._end)
        sys.monitoring.set_events(TOOL, events.PY_START | events.PY_RETURN | events.PY_UNWIND)
        return self

    def __exit__(self, *_):
        sys.monitoring.set_events(TOOL, 0)
        sys.monitoring.free_tool_id(TOOL)

    def _begin(self, code, _offset):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if self._frame is None and threading.current_thread() is threading.main_thread():
            self._frame, self._begun = sys._getframe(1), time.perf_counter()
        return None

    def _end(self, code, *_):
        if self._frame is sys._getframe(1):
            self.found.append((time.perf_counter() - self._begun, code.co_qualname))
            self._frame = None
