"""The cache folder is counted and emptied on a thread: it may hold gigabytes in many files, and lie on a slow disk."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator
from functools import partial
from pathlib import Path

from ...core import bake_cache
from ...core.background_call import run_in_thread

_going: set[Path] = set()


def going() -> set[Path]:
    """Bake folders that are being deleted."""
    return set(_going)


def count(folder: Path) -> Generator[None, None, tuple[int, int]]:
    """Bakes in a cache folder and their bytes; yields until that is known."""

    def look() -> tuple[int, int]:
        bakes = list(bake_cache.bakes_in(folder))
        return len(bakes), sum(bake_cache.size_of(bake) for bake in bakes)

    return (yield from run_in_thread(look))


def clean(folder: Path, in_use: Callable[[], Collection[Path]]) -> Generator[None, None, tuple[int, list[str]]]:
    """Deletes the bakes in a cache folder but for those that are in use when it is their turn, and yields meanwhile.
    How many are gone, and problems in words."""
    gone = 0
    problems: list[str] = []
    for bake in (yield from run_in_thread(lambda: list(bake_cache.bakes_in(folder)))):
        used = in_use()
        _going.add(bake)
        try:
            more, said = yield from run_in_thread(partial(bake_cache.remove, [bake], used))
        finally:
            _going.discard(bake)
        gone, problems = gone + more, problems + said
    return gone, problems
