"""How long the add-on keeps Blender's main thread: every outermost call of its Python code is timed, by the clock,
which counts waiting (for a lock, a disk, a processor that others use) too, and by the thread's own processor time."""

import gc
import os
import resource
import sys
import threading
import time
from collections import Counter
from dataclasses import astuple, dataclass, field, replace
from types import FrameType

TOOL = sys.monitoring.PROFILER_ID
SLOW_SECONDS = 0.04
"""Calls that take longer are remembered one by one."""
OF_BLENDER = {
    "_begin_render": "Blender begins a render",
    "compile_program": "the driver compiles a shader",
    "_draw_nothing": "the driver compiles what draws pictures",
    "draw_nothing": "the driver compiles what draws rings",
    "draw_no_strokes": "the driver compiles what draws strokes",
    "draw_no_rectangles": "the driver compiles what draws rectangles",
}
"""Functions of the add-on that do nothing but have Blender or the graphics driver do what they do once in a session,
and what that is. The scenario `cost` measures some of it without the add-on."""
SHARE = 0.5
"""How much of a call's time a call inside of it must have taken to be named as what takes it."""
QUICK_SECONDS = 0.0005
"""Calls inside of others that are no longer are seen MANY times only: to see each would take longer than the call
itself, so that whoever calls small functions often would seem slow."""
MANY = 20
NAMED = 3
"""Calls of a turn that are named: those that took longest."""


@dataclass(frozen=True)
class OfMachine:
    """What the main thread had of the machine, since it began or in some span of time."""

    queue: float = 0.0
    """Seconds in which it was ready to run and others had the processors."""
    kernel: float = 0.0
    """Seconds of the processor in Linux itself."""
    pages: int = 0
    """Pages of memory that were touched for the first time. Each takes a microsecond, but ten and more where the
    machine is a virtual one and its host has to find the memory first."""

    def __add__(self, other):
        return OfMachine(*(a + b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __sub__(self, other):
        return OfMachine(*(a - b for a, b in zip(astuple(self), astuple(other), strict=True)))

    def __str__(self):
        words = f", {self.queue * 1000:.1f} ms in the processors' queue" if self.queue > QUICK_SECONDS else ""
        if self.kernel > QUICK_SECONDS:
            words += f", {self.kernel * 1000:.1f} ms in the kernel, {self.pages} new pages of memory"
        return words


@dataclass(frozen=True)
class Call:
    """A call that has ended: seconds by the clock and of the processor, and the functions that took them."""

    name: str = ""
    seconds: float = 0.0
    processor: float = 0.0
    inner: "Call | None" = None
    """The longest call of the add-on inside of this one."""
    of_blender: dict[str, float] = field(default_factory=dict)
    """Seconds of the processor in it that are OF_BLENDER."""
    of_machine: OfMachine = OfMachine()
    """Of an outermost call."""

    @property
    def own(self):
        """Seconds of the processor but for those."""
        return self.processor - sum(self.of_blender.values())

    def __str__(self):
        words = f"{self.seconds * 1000:.1f} ms ({self.processor * 1000:.1f} ms of the processor{self.of_machine})"
        words += f": {self.name}"
        inner = self.inner
        while inner and inner.seconds > SHARE * self.seconds:
            words += f" > {inner.name}"
            inner = inner.inner
        for what, processor in self.of_blender.items():
            words += f"; of that {processor * 1000:.1f} ms of the processor while {what}"
        return words


@dataclass
class Turn:
    """What the add-on had of a turn of Blender's window, in which it may be called several times."""

    by_name: Counter = field(default_factory=Counter)
    """Seconds of its calls."""
    of_machine: OfMachine = OfMachine()

    @property
    def seconds(self):
        """Of all of them."""
        return sum(self.by_name.values())

    def __str__(self):
        parts = (f"{name} {seconds * 1000:.1f}" for name, seconds in self.by_name.most_common(NAMED))
        return f"{self.seconds * 1000:.1f} ms{self.of_machine}: {', '.join(parts)}"


@dataclass
class _Open:
    """A call that has not ended: when it began by both times, and what has ended in it."""

    frame: FrameType
    began: float
    began_processor: float
    began_machine: OfMachine = OfMachine()
    inner: Call | None = None
    of_blender: dict[str, float] = field(default_factory=dict)


class Watch:
    """Sees calls of code below a folder. Code elsewhere is switched off at its first call and costs nothing."""

    def __init__(self, folder):
        self._folder = str(folder)
        self._open = []
        """The outermost first."""
        self._main = threading.main_thread().ident
        self._schedule = os.open(f"/proc/self/task/{threading.main_thread().native_id}/schedstat", os.O_RDONLY)
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
        self._collecting = 0.0
        gc.callbacks.append(self._collect)
        self.reset()

    def reset(self):
        """Forgets what it has seen."""
        self.calls, self.slow = 0, []
        self.turn, self.longest_turn = Turn(), Turn()
        self.longest = self.heaviest = self.first_time = Call()
        self._outermost, self._quick = set(), Counter()
        """Codes that Blender itself has called, and how often others were called and took no time."""
        sys.monitoring.restart_events()

    def _enter(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            if not self._open:
                self._outermost.add(code)
            elif self._quick[code] >= MANY and code not in self._outermost:
                return sys.monitoring.DISABLE
            machine = OfMachine() if self._open else self._machine()
            self._open.append(_Open(_frame_of(code), time.perf_counter(), time.thread_time(), machine))
        return None

    def _leave(self, code, *_):
        if not code.co_filename.startswith(self._folder):
            return sys.monitoring.DISABLE
        if threading.get_ident() == self._main:
            seconds, processor = time.perf_counter(), time.thread_time()
            begun = self._pop(_frame_of(code))
            if begun is None:  # It was not seen to begin.
                return sys.monitoring.DISABLE
            name, seconds, processor = code.co_qualname, seconds - begun.began, processor - begun.began_processor
            of_blender = {OF_BLENDER[name]: processor} if name in OF_BLENDER else begun.of_blender
            call = Call(name, seconds, processor, begun.inner, of_blender)
            if self._open:
                self._quick[code] += seconds < QUICK_SECONDS
                self._note_inside(self._open[-1], call)
            else:
                self._note(replace(call, of_machine=self._machine() - begun.began_machine))
        return None

    def _machine(self):
        """Since the main thread began. Linux: `sched-stats.rst`, `getrusage(2)`."""
        queue = int(os.pread(self._schedule, 64, 0).split()[1]) * 1e-9
        used = resource.getrusage(resource.RUSAGE_THREAD)
        return OfMachine(queue, used.ru_stime, used.ru_minflt)

    def _collect(self, phase, _about):
        """Python collects garbage, which all that runs in it has left: whose call that falls into is chance."""
        if threading.get_ident() != self._main or not self._open:
            return
        if phase == "start":
            self._collecting = time.thread_time()
        else:
            of_blender, what = self._open[-1].of_blender, "Python collects garbage"
            of_blender[what] = of_blender.get(what, 0.0) + time.thread_time() - self._collecting

    def _pop(self, frame):
        """Takes out the open call of a frame, with those in it whose end was not seen; None if it is not there."""
        places = [place for place, call in enumerate(self._open) if call.frame is frame]
        if not places:
            return None
        begun = self._open[places[0]]
        del self._open[places[0] :]
        return begun

    @staticmethod
    def _note_inside(outer, call):
        """A call inside of another has ended."""
        if outer.inner is None or outer.inner.seconds < call.seconds:
            outer.inner = call
        for what, processor in call.of_blender.items():
            outer.of_blender[what] = outer.of_blender.get(what, 0.0) + processor

    def _note(self, call):
        """An outermost call has ended."""
        self.calls += 1
        self.turn.by_name[call.name] += call.seconds
        self.turn.of_machine += call.of_machine
        self.longest = max(self.longest, call, key=lambda it: it.seconds)
        self.heaviest = max(self.heaviest, call, key=lambda it: it.own)
        self.first_time = max(self.first_time, call, key=lambda it: it.processor - it.own)
        if call.seconds > SLOW_SECONDS:
            self.slow.append(call)

    def end_turn(self):
        """A turn of the window has ended."""
        self.longest_turn = max(self.longest_turn, self.turn, key=lambda it: it.seconds)
        self.turn = Turn()

    # Exceptions cannot be switched off for a single place: these must not return DISABLE.
    def _enter_by_exception(self, code, *_):
        self._enter(code)

    def _leave_by_exception(self, code, *_):
        self._leave(code)


def _frame_of(code):
    """The frame that runs a code, seen from a callback about it."""
    frame = sys._getframe()
    while frame.f_code is not code:
        frame = frame.f_back
    return frame
