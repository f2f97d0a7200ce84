"""Locations and files of bake folders."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

MANIFEST = "manifest.json"
PATHS = (MANIFEST, "guided.json", "world.exr", "tile_*.safetensors", "training_*.safetensors")
"""Files of paths, and what is made of those paths alone. The manifest goes first: what is left after a crash is never
taken for a bake."""
CONTENTS = "contents.json"
"""File in which the native module lists the files that the folder should hold."""
OWN_FILES = (
    *(*PATHS, "lights.json", "shot.json", "wanted.json", "view.png", "base.exr", CONTENTS, "baking.lock"),
    *("scene.scene", "proxy_*.safetensors", "proxy_*.json"),
)
"""Names of all files of a bake and its proxies."""
OTHER_WORLD = "map of the world"
"""The native module's word for a bake that differs by nothing but the world's texture and how that is turned."""

SOLVE = "solve"
"""Folder in a bake's, for the few paths that a solver needs for a moment."""


def default_folder(blend_file: str, scene: str, shot: str, cache: Path, unsaved: str) -> Path:
    """Beside a saved .blend file, in `relume/`; in the cache folder for a file that was never saved, which `unsaved`
    tells from others. The name of the file is a part of it: versions of a shot often lie in one folder. `shot` is the
    name of the camera, or of a listed shot in folders."""
    if not blend_file:
        return cache / file_name(f"unsaved_{scene}_{shot}_{unsaved}")
    file = Path(blend_file)
    return file.parent / "relume" / file_name(f"{file.stem}_{scene}_{shot}")


def is_bake(folder: Path) -> bool:
    """True if a folder holds a manifest that Relume wrote."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and {"scene_hash", "passes", "tile_size"} <= manifest.keys()


def why_no_bake(places: Sequence[Path]) -> str:
    """Why there is no bake in the folders where a file remembers it; empty if there is one."""
    if any(map(is_bake, places)):
        return ""
    folder = places[0]
    if next(folder.glob("tile_*.safetensors"), None) is not None:
        return f"{MANIFEST} is missing or damaged in {folder}"
    return f"The bake is not where it was: {folder}"


def camera_of(folder: Path) -> str:
    """Name of the camera that a bake was made with; empty if it cannot be read."""
    try:
        return str(json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["camera"]["name"])
    except (OSError, ValueError, KeyError, TypeError):
        return ""


def size_of(folder: Path) -> tuple[int, int] | None:
    """Width and height of a bake's picture; None if it cannot be read."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        return int(manifest["width"]), int(manifest["height"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def world_map_of(folder: Path) -> str | None:
    """The world that a bake was begun under, in the native module's words; None if it cannot be read."""
    try:
        return str(json.loads((folder / MANIFEST).read_text(encoding="utf-8"))["world_map"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def file_name(text: str) -> str:
    """Letters, digits and a few signs that every file system takes."""
    return re.sub(r"[^\w.-]+", "_", text).strip("._") or "shot"


def clear_paths(folder: Path) -> None:
    """Removes the paths of a bake, for new ones of the same scene under whatever world: its proxies stay right."""
    _remove(folder, PATHS)


def clear(folder: Path) -> None:
    """Removes the files of a bake and its proxies, and what a solver left there; other files stay."""
    _remove(folder, OWN_FILES)
    if is_bake(folder / SOLVE):
        clear(folder / SOLVE)
        with suppress(OSError):  # Something else is in it.
            (folder / SOLVE).rmdir()


def _remove(folder: Path, patterns: Iterable[str]) -> None:
    for pattern in patterns:
        for file in folder.glob(pattern):
            file.unlink()
