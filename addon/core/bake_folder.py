"""Where a bake belongs."""

from __future__ import annotations

import json
import re
from pathlib import Path

MANIFEST = "manifest.json"


def default_folder(blend_file: str, scene: str, camera: str, cache: Path) -> Path:
    """Beside a saved .blend file, in `relume/`; in the cache folder for a file that was never saved."""
    name = _file_name(f"{scene}_{camera}")
    return Path(blend_file).parent / "relume" / name if blend_file else cache / "unsaved" / name


def is_bake(folder: Path) -> bool:
    """Whether a folder holds a manifest that Relume wrote."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and {"scene_hash", "passes", "tile_size"} <= manifest.keys()


def _file_name(text: str) -> str:
    """Letters, digits and a few signs that every file system takes."""
    return re.sub(r"[^\w.-]+", "_", text).strip("._") or "shot"
