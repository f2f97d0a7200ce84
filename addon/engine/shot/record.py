"""Record of the scene that a bake was made of: its fingerprints, and the meaning of its receivers."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import bpy

from ...core import whole_file
from ...core.diff import ORDER, Fingerprint
from ...export.linking import receiver_names
from ..staleness import fingerprints

FILE = "shot.json"
FORMAT, VERSION = "relume-shot", 1


@dataclasses.dataclass(frozen=True)
class Record:
    """Contents of `shot.json`."""

    camera: str
    receivers: list[str]
    """Full names of the scene's objects that light linking counts, in its order."""
    fingerprints: dict[str, Fingerprint]
    maps: dict[str, str] = dataclasses.field(default_factory=dict)
    """Shape in the fingerprint of each world that was shown, by the native module's name of its map."""

    def write(self, folder: Path) -> None:
        """Writes the record into a bake folder, whole or not at all."""
        content = {
            "format": FORMAT,
            "version": VERSION,
            "camera": self.camera,
            "receivers": self.receivers,
            "prints": self.fingerprints,
            "maps": self.maps,
        }
        whole_file.write_json(folder / FILE, content)


def forget(folder: Path) -> None:
    """Removes the record of a bake that is about to be replaced."""
    (folder / FILE).unlink(missing_ok=True)


def read(folder: Path) -> Record | None:
    """Record of a bake; None if there is none, or it cannot be read."""
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if content["format"] != FORMAT or content["version"] != VERSION:
            return None
        known = {key: value for key, value in content["prints"].items() if key.partition(" ")[0] in ORDER}
        baked = {key: _strings(value) for key, value in known.items()}
        maps = _strings(content.get("maps", {}))
        return Record(str(content["camera"]), [str(name) for name in content["receivers"]], baked, maps)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None


def _strings(value: dict) -> dict[str, str]:
    return {str(part): str(text) for part, text in value.items()}


def of(
    scene: bpy.types.Scene,
    world_map: str,
    camera: bpy.types.Object | None = None,
    size: tuple[int, int] | None = None,
) -> Record:
    """Record of the present scene, taken at once. `world_map` is the native module's name of its world's map; `camera`
    and `size` are the scene's own by default."""
    camera = camera or scene.camera
    taken = fingerprints.all_fingerprints(scene, camera, size)
    return Record(camera.name, receiver_names(scene), taken, {world_map: taken["world"]["shape"]})
