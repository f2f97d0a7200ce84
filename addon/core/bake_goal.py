"""Goal of a bake that is not whole: the samples and training that were asked for.

The file lies in the bake's folder until the goal is met, so the bake can go on after a stop or after Blender has died.
The manifest cannot tell: the first training comes before most samples."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from pathlib import Path

from . import whole_file

FILE = "wanted.json"
FORMAT, VERSION = "relume-wanted", 1


@dataclasses.dataclass(frozen=True)
class BakeGoal:
    """Contents of the goal's file."""

    samples: int
    """Paths per pixel."""
    train_seconds: float
    """Seconds of training for each kind of light; 0 for none."""

    def write(self, folder: Path) -> None:
        """Writes the goal into a bake folder."""
        folder.mkdir(parents=True, exist_ok=True)
        whole_file.write_json(folder / FILE, {"format": FORMAT, "version": VERSION, **vars(self)})


def forget(folder: Path) -> None:
    """Removes the goal of a bake that has met it. If the file cannot go, Relume only offers to go on once more."""
    with contextlib.suppress(OSError):
        (folder / FILE).unlink()


def read(folder: Path) -> BakeGoal | None:
    """Goal that a bake has not met; None if it is whole, or if the file cannot be read."""
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if content["format"] != FORMAT or content["version"] != VERSION:
            return None
        return BakeGoal(int(content["samples"]), float(content["train_seconds"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
