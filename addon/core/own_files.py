"""Files of the add-on itself, wherever Blender has put it. They are only read."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

PACKAGE = __package__.rpartition(".")[0]
"""Name of the add-on's package, which Blender gives to an extension."""


def addon_folder() -> Path:
    """Folder of the add-on."""
    return Path(str(files(PACKAGE)))
