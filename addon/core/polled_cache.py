"""Values that are slow to read, such as a disk's: read on threads, and the last one returned meanwhile."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, TypeVar

Key = TypeVar("Key", bound=Hashable)
Value = TypeVar("Value")

WAIT_SECONDS = 0.005
"""Seconds to wait for the first read of a value: a local disk answers sooner."""


class PolledCache:
    """Last value of each read, by its function and key."""

    def __init__(self, max_age_seconds: float):
        self.max_age_seconds = max_age_seconds
        """Age from which a value is read again."""
        self._entries: dict[tuple, _CachedValue] = {}

    def get(self, read: Callable[[Key], Value], key: Key) -> Value | None:
        """Last value of `read(key)`; None until the first one is there. `read` is called on a thread, and must touch
        nothing of Blender's."""
        entry = self._entries.setdefault((read, key), _CachedValue())
        if not entry.is_pending and time.monotonic() - entry.when > self.max_age_seconds:
            entry.start(partial(read, key))
        return entry.value

    @property
    def is_pending(self) -> bool:
        """True while a read is under way."""
        return any(entry.is_pending for entry in self._entries.values())


class _CachedValue:
    def __init__(self) -> None:
        self.value: Any = None
        self.when = -math.inf
        """Time at which the value was read."""
        self.is_pending = False

    def start(self, read: Callable[[], Any]) -> None:
        self.is_pending = True
        # No thread pool: Python waits for a pool's threads when it exits, and a disk may never answer.
        thread = threading.Thread(target=self._run, args=(read,), name="relume-disk", daemon=True)
        thread.start()
        if self.when == -math.inf:
            thread.join(WAIT_SECONDS)

    def _run(self, read: Callable[[], Any]) -> None:
        try:
            self.value = read()
        finally:
            self.when, self.is_pending = time.monotonic(), False
