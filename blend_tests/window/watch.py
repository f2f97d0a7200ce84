"""How long the add-on keeps Blender's main thread: every outermost call of its Python code is timed."""

import sys
import threading
import time

TOOL = sys.monitoring.PROFILER_ID
SLOW_SECONDS = 0.04
"""Calls that take longer are remembered one by one."""


class Watch:
    """Sees calls of code below a folder. Code elsewhere is switched off at its first call and costs nothing."""

    def __init__(self, folder):
        self.calls = 0
        self.longest = (0.0, "")
        self.slow = []
        self._folder = str(folder)
        self._depth = 0
        self._began = 0.0
        self._main = threading.main_thread().ident
        events = sys.monitoring.events
        callbacks = {
            events.PY_START: self._enter,
            events.PY_RESUME: self._enter,
            events.PY_RETURN: self._leave,
            events.PY_YIELD: self._leave,
            events.PY_THROW: self._enter_by_exception,
            events.PY_UNWIND: self._leave_by_exception,
        }
        sys.monitoring.use_tool_id(TOOL, "relume window tests")
        for event, callback in callbacks.items():
            sys.monitoring.register_callback(TOOL, event, callback)
        sys.monitoring.set_events(TOOL, sum(callbacks))

    def reset(self):
        """Forgets what it has seen."""
        self.calls, self.longest, self.slow = 0, (0.0, ""), []

    def _enter(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            self._depth += 1
            if self._depth == 1:
                self._began = time.perf_counter()
        return None

    def _leave(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            self._depth -= 1
            if self._depth == 0:
                self.calls += 1
                took = time.perf_counter() - self._began
                self.longest = max(self.longest, (took, code.co_qualname))
                if took > SLOW_SECONDS:
                    self.slow.append((took, code.co_qualname))
        return None

    # Exceptions cannot be switched off for a single place: these must not return DISABLE.
    def _enter_by_exception(self, code, *_):
        self._enter(code)

    def _leave_by_exception(self, code, *_):
        self._leave(code)
