"""The folder of bakes that belong to no file: how large it is, and emptying it."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

from .bake_folder import clear, is_bake


def bakes_in(folder: Path) -> Iterator[Path]:
    """Folders in a cache folder that hold a bake. What else is there is not ours; links are not followed."""
    try:
        entries = sorted(folder.iterdir())
    except OSError:
        return
    yield from (entry for entry in entries if not entry.is_symlink() and entry.is_dir() and is_bake(entry))


def size_of(bake: Path) -> int:
    """Bytes of all files of a bake."""
    size = 0
    for file in bake.rglob("*"):
        with suppress(FileNotFoundError):  # A bake that goes on renames and deletes files.
            size += file.lstat().st_size if file.is_file() else 0
    return size


def remove(bakes: list[Path], in_use: Collection[Path]) -> tuple[int, list[str]]:
    """Deletes bakes but for those in use; other files in their folders stay. How many are gone, and what kept others,
    in words."""
    gone, problems = 0, []
    for bake in bakes:
        if bake in in_use:
            problems.append(f"'{bake.name}' is in use and was kept")
            continue
        try:
            clear(bake)
            gone += 1
            with suppress(OSError):  # Something else is in it.
                bake.rmdir()
        except OSError as error:
            problems.append(f"'{bake.name}' could not be deleted: {error.strerror or error}")
    return gone, problems
