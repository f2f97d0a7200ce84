"""What a bake that is under way shall become, beside it in its folder until it is there: so it can go on after a stop,
or after Blender has died. The manifest cannot tell, because the first training comes before most samples."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from pathlib import Path

from . import whole_file

FILE = "wanted.json"
FORMAT, VERSION = "relume-wanted", 1


@dataclasses.dataclass(frozen=True)
class Wanted:
    """The contents of `wanted.json`."""

    samples: int
    """Paths per pixel."""
    train_seconds: float
    """For each kind of light; 0 for no training."""

    def write(self, folder: Path) -> None:
        """Writes it into a bake folder."""
        folder.mkdir(parents=True, exist_ok=True)
        whole_file.write_json(folder / FILE, {"format": FORMAT, "version": VERSION, **vars(self)})


def forget(folder: Path) -> None:
    """The bake is what was wanted. If the file cannot go, no more comes of it than an offer to go on."""
    with contextlib.suppress(OSError):
        (folder / FILE).unlink()


def read(folder: Path) -> Wanted | None:
    """What is still wanted of a bake; None if it is whole, or if that cannot be read."""
    try:
        content = json.loads((folder / FILE).read_text(encoding="utf-8"))
        if content["format"] != FORMAT or content["version"] != VERSION:
            return None
        return Wanted(int(content["samples"]), float(content["train_seconds"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
