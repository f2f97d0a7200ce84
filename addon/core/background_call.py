"""Blocking work on a thread of its own, polled from a generator."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")


def run_in_thread(work: Callable[[], Result]) -> Generator[None, None, Result]:
    """Runs `work` on a new thread and yields until it ends; then returns its result, or raises its exception.

    The thread starts at the first `next`, not at the call. Use as `result = yield from run_in_thread(work)`."""
    thread = ThreadPoolExecutor(1, "relume")
    future = thread.submit(work)
    thread.shutdown(wait=False)
    while not future.done():
        yield
    return future.result()
