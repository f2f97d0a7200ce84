"""How long the add-on keeps Blender's main thread: every outermost call of its Python code is timed, by the clock,
which counts waiting (for a lock, a disk, a processor that others use) too, and by the thread's own processor time."""

import sys
import threading
import time
from dataclasses import dataclass

TOOL = sys.monitoring.PROFILER_ID
SLOW_SECONDS = 0.04
"""Calls that take longer are remembered one by one."""
SHARE = 0.5
"""How much of a call's time a call inside of it must have taken to be named as what takes it."""


@dataclass(frozen=True)
class Call:
    """A call that has ended: seconds by the clock and of the processor, and the functions that took them."""

    name: str = ""
    seconds: float = 0.0
    processor: float = 0.0
    inner: "Call | None" = None
    """The longest call of the add-on inside of this one."""

    def __str__(self):
        words = f"{self.seconds * 1000:.1f} ms ({self.processor * 1000:.1f} ms of the processor): {self.name}"
        inner = self.inner
        while inner and inner.seconds > SHARE * self.seconds:
            words += f" > {inner.name}"
            inner = inner.inner
        return words


class Watch:
    """Sees calls of code below a folder. Code elsewhere is switched off at its first call and costs nothing."""

    def __init__(self, folder):
        self.reset()
        self._folder = str(folder)
        self._open = []
        """Calls that have not ended, the outermost first: when they began, by both times, and the longest inside."""
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
        self.calls, self.longest, self.heaviest, self.slow = 0, Call(), Call(), []

    def _enter(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            self._open.append([time.perf_counter(), time.thread_time(), None])
        return None

    def _leave(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            began, began_processor, inner = self._open.pop()
            seconds, processor = time.perf_counter() - began, time.thread_time() - began_processor
            call = Call(code.co_qualname, seconds, processor, inner)
            if not self._open:
                self._note(call)
            elif self._open[-1][2] is None or self._open[-1][2].seconds < seconds:
                self._open[-1][2] = call
        return None

    def _note(self, call):
        """An outermost call has ended."""
        self.calls += 1
        self.longest = max(self.longest, call, key=lambda it: it.seconds)
        self.heaviest = max(self.heaviest, call, key=lambda it: it.processor)
        if call.seconds > SLOW_SECONDS:
            self.slow.append(call)

    # Exceptions cannot be switched off for a single place: these must not return DISABLE.
    def _enter_by_exception(self, code, *_):
        self._enter(code)

    def _leave_by_exception(self, code, *_):
        self._leave(code)
