"""The list of a scene's shots as plain data: names, folders, what is wrong with them, and the file that other programs
read."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from . import whole_file
from .bake_folder import file_name, is_bake, size_of

FORMAT, VERSION = "relume-shots", 1
ALL = "all"
"""Word for every shot that is switched on."""
AUTOMATIC = ""
"""Key of the one shot of a scene where nobody has made a list."""


class ShotsError(ValueError):
    """Shots cannot be used as asked for; the message names them."""


@dataclass(frozen=True)
class ListedShot:
    """A shot of the list."""

    name: str
    camera: str
    """Name of the camera object; where it is gone, the last one that is known."""
    folder: Path
    key: str = AUTOMATIC
    """Name in folders, which stays when the shot is renamed."""
    frame: int | None = None
    """None for the frame that is current."""
    layer: str = ""
    """View layer; empty for the first one that Blender renders."""
    size: tuple[int, int] | None = None
    """Width and height in pixels; None for the scene's."""
    on: bool = True
    is_foreign: bool = False
    """True for a bake of another scene or file, which is shown and never written."""

    @property
    def state(self) -> tuple[int | None, str, tuple[int, int] | None]:
        """Frame, layer and size: its scene depends on these and the camera alone."""
        return self.frame, self.layer, self.size


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, with a number behind it as Blender does where another shot has it."""
    found, number = name, 0
    while found in taken:
        number += 1
        found = f"{name}.{number:03}"
    return found


def free_key(name: str, taken: Collection[str]) -> str:
    """A name for folders on every file system, other than those taken: some take upper and lower case for the same."""
    plain, low = file_name(name), {key.lower() for key in taken}
    found, number = plain, 1
    while found.lower() in low:
        number += 1
        found = f"{plain}_{number}"
    return found


@dataclass(frozen=True)
class Marker:
    """A marker of the timeline that a camera is bound to."""

    name: str
    frame: int
    camera: str


def shots_of_markers(markers: Iterable[Marker], known: Collection[tuple[str, int | None]]) -> list[Marker]:
    """The markers in the order of their frames, without those whose camera and frame are listed already."""
    found: dict[tuple[str, int | None], Marker] = {}
    for marker in sorted(markers, key=lambda marker: marker.frame):
        found.setdefault((marker.camera, marker.frame), marker)
    return [marker for key, marker in found.items() if key not in known]


def problems(
    shots: Iterable[ListedShot],
    cameras: Collection[str],
    layers: Collection[str],
    elsewhere: Mapping[Path, str],
    is_there: Callable[[Path], bool] = is_bake,
) -> dict[str, str]:
    """Reasons that keep shots from being baked, in words, by their keys. `cameras` and `layers` are those of the scene,
    `elsewhere` the folders of other scenes' shots, with words for whose; `is_there` is called like `is_bake`."""
    found: dict[str, str] = {}
    taken: dict[Path, str] = {}
    for shot in shots:
        if shot.is_foreign and not is_there(shot.folder):
            found[shot.key] = f"there is no bake in '{shot.folder}'"
        elif words := _problem(shot, cameras, layers, {**elsewhere, **taken}):
            found[shot.key] = words
        taken.setdefault(shot.folder, f"shot '{shot.name}'")
    return found


def _problem(shot: ListedShot, cameras: Collection[str], layers: Collection[str], taken: Mapping[Path, str]) -> str:
    if shot.folder in taken:
        return f"{taken[shot.folder]} has the folder '{shot.folder}' already; choose another one"
    if shot.is_foreign:
        return ""
    if not shot.camera:
        return "it has no camera; choose one"
    if shot.camera not in cameras:
        return f"its camera '{shot.camera}' is not in the scene; choose another one, or remove the shot"
    if shot.layer and shot.layer not in layers:
        return f"the scene has no view layer '{shot.layer}'; choose another one"
    return ""


def chosen(shots: Iterable[ListedShot], words: str) -> list[ListedShot]:
    """The shots that words name: `all` for those that are on, or names with commas between. Raises ShotsError."""
    known = {shot.name: shot for shot in shots}
    if words == ALL:
        if not (found := [shot for shot in known.values() if shot.on]):
            raise ShotsError("no shot is switched on")
        return found
    names = [words] if words in known else [name.strip() for name in words.split(",") if name.strip()]
    if unknown := [name for name in names if name not in known]:
        there = ", ".join(f"'{name}'" for name in known)
        raise ShotsError(f"there is no shot {', '.join(map(repr, unknown))}; there are {there}")
    if not names:
        raise ShotsError("no shot is named")
    return [known[name] for name in dict.fromkeys(names)]


def write_file(shots: Iterable[ListedShot], file: Path, source: str) -> list[str]:
    """Writes the list of the shots that are on and have a bake, for the native program; returns their names. Removes an
    older list where there are none."""
    found = [shot for shot in shots if shot.on and is_bake(shot.folder)]
    if not found:
        file.unlink(missing_ok=True)
        return []
    file.parent.mkdir(parents=True, exist_ok=True)
    entries = [
        {
            "name": shot.name,
            "bake": relative(shot.folder, file.parent),
            "camera": shot.camera,
            "frame": shot.frame,
            "layer": shot.layer,
            "size": size_of(shot.folder),
            "source": "" if shot.is_foreign or not source else relative(Path(source), file.parent),
        }
        for shot in found
    ]
    whole_file.write(file, json.dumps({"format": FORMAT, "version": VERSION, "shots": entries}, indent=2) + "\n")
    return [shot.name for shot in found]


def relative(path: Path, folder: Path) -> str:
    """A path as seen from a folder, with forward slashes; absolute on another drive of Windows."""
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return path.as_posix()
