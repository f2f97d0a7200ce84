"""Files that are there whole or not at all, in which damage is found."""

from __future__ import annotations

import json
import os
import zlib
from pathlib import Path
from typing import Any


def write(path: Path, text: str) -> None:
    """Writes a text file beside its place first, then moves it there."""
    part = path.with_name(f".part-{path.name}")
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Writes JSON whole or not at all. Its `checksum` is the CRC-32 of the text with an empty one."""
    text = json.dumps({**content, "checksum": ""})
    head, _, tail = text.rpartition('""')
    write(path, f'{head}"{zlib.crc32(text.encode()):08x}"{tail}')
