"""Questions to a disk, which may be slow or far away: asked on threads, with what was answered last."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, TypeVar

About = TypeVar("About", bound=Hashable)
Answer = TypeVar("Answer")

WAIT_SECONDS = 0.005
"""How long a first answer is waited for: of a disk of this machine it comes sooner."""


class Answers:
    """By question, what was last answered."""

    def __init__(self, again_seconds: float):
        self.again_seconds = again_seconds
        """An older answer is asked for anew."""
        self._known: dict[tuple, _Question] = {}

    def of(self, ask: Callable[[About], Answer], about: About) -> Answer | None:
        """What `ask(about)` returned last; None as long as that is not known. It is called on a thread, and must touch
        nothing of Blender's."""
        question = self._known.setdefault((ask, about), _Question())
        if not question.is_asked and time.monotonic() - question.when > self.again_seconds:
            question.put(partial(ask, about))
        return question.answer

    @property
    def are_awaited(self) -> bool:
        """Whether answers are still to come."""
        return any(question.is_asked for question in self._known.values())


class _Question:
    def __init__(self) -> None:
        self.answer: Any = None
        self.when = -math.inf
        """When the answer came."""
        self.is_asked = False

    def put(self, ask: Callable[[], Any]) -> None:
        self.is_asked = True
        # Not of a pool: Python's end would wait for one whose disk never answers.
        thread = threading.Thread(target=self._run, args=(ask,), name="relume-disk", daemon=True)
        thread.start()
        if self.when == -math.inf:
            thread.join(WAIT_SECONDS)

    def _run(self, ask: Callable[[], Any]) -> None:
        try:
            self.answer = ask()
        finally:
            self.when, self.is_asked = time.monotonic(), False
