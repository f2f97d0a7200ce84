"""Plain data with arrays anywhere in it, in one file: a line of JSON, then the arrays. numpy writes and reads arrays
without Python's lock."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

ARRAY = "array"
"""Key of what stands in the JSON for the next array."""


def write(path: Path, data: Any) -> None:
    """Writes a file. Raises OSError."""
    arrays: list[np.ndarray] = []

    def stand_in(value: Any) -> dict[str, bool]:
        if not isinstance(value, np.ndarray):
            raise TypeError(f"{type(value).__name__} is no plain data")
        arrays.append(value)
        return {ARRAY: True}

    line = json.dumps(data, default=stand_in)
    with path.open("wb") as file:
        file.write(line.encode() + b"\n")
        for array in arrays:
            np.save(file, array, allow_pickle=False)


def read(path: Path) -> Any:
    """Reads what was written. Raises OSError, and ValueError if it is another file."""
    with path.open("rb") as file:

        def arrays_in(found: dict[str, Any]) -> Any:
            is_array = found.keys() == {ARRAY} and found[ARRAY] is True
            return np.load(file, allow_pickle=False) if is_array else found

        return json.loads(file.readline(), object_hook=arrays_in)
