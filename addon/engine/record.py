"""What lies beside a bake so that it is found right again: prints of its scene, and the meaning of its receivers."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import bpy

from ..core import whole_file
from ..core.diff import ORDER, Print
from ..export.linking import receiver_names
from . import prints

FILE = "shot.json"
FORMAT, VERSION = "relume-shot", 1


@dataclasses.dataclass(frozen=True)
class Record:
    """The contents of `shot.json`."""

    camera: str
    receivers: list[str]
    """Full names of the scene's objects that light linking counts, in its order."""
    prints: dict[str, Print]
    maps: dict[str, str] = dataclasses.field(default_factory=dict)
    """Shapes of prints of worlds that were shown, by what the native module calls them."""

    def write(self, folder: Path) -> None:
        """Writes it into a bake folder, whole or not at all."""
        whole_file.write_json(folder / FILE, {"format": FORMAT, "version": VERSION, **vars(self)})


def forget(folder: Path) -> None:
    """Removes the record of a bake that is about to be replaced."""
    (folder / FILE).unlink(missing_ok=True)


def read(folder: Path) -> Record | None:
    """The record of a bake; None if there is none, or none that can be read."""
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if content["format"] != FORMAT or content["version"] != VERSION:
            return None
        known = {key: value for key, value in content["prints"].items() if key.partition(" ")[0] in ORDER}
        found = {key: _print(value) for key, value in known.items()}
        maps = _print(content.get("maps", {}))
        return Record(str(content["camera"]), [str(name) for name in content["receivers"]], found, maps)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _print(value: dict) -> Print:
    return {str(part): str(text) for part, text in value.items()}


def of(
    scene: bpy.types.Scene,
    world_map: str,
    camera: bpy.types.Object | None = None,
    size: tuple[int, int] | None = None,
) -> Record:
    """A record of the present scene, taken at once, whose world the native module calls so; of another camera or size
    than the scene's if named."""
    camera = camera or scene.camera
    found = prints.take_all(scene, camera, size)
    return Record(camera.name, receiver_names(scene), found, {world_map: found["world"]["shape"]})
