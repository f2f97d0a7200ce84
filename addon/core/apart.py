"""Work on a thread of its own, waited for a moment at a time."""

from __future__ import annotations

from collections.abc import Callable, Generator
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Found = TypeVar("Found")


def apart(work: Callable[[], Found]) -> Generator[None, None, Found]:
    """Begins at once, yields while it goes on, and returns or raises what came of it: `yield from apart(work)`."""
    thread = ThreadPoolExecutor(1, "relume")
    future = thread.submit(work)
    thread.shutdown(wait=False)
    while not future.done():
        yield
    return future.result()
