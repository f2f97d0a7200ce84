"""Two frames beside each other, for example of two looks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import bpy

from .views import redraw

MODES = ("WIPE", "A", "B", "DIFFERENCE")


@dataclass(frozen=True)
class Pair:
    """Frames as `engine.shot.shot` gives them; B is None for the live picture."""

    a: Any
    b: Any | None
    labels: tuple[str, str]


_pairs: dict[int, Pair] = {}


def set_pair(
    scene: bpy.types.Scene, frame_a: Any, frame_b: Any | None, mode: str, labels: tuple[str, str] = ("A", "B")
) -> None:
    """Shows two frames in a mode of MODES, until `clear`; the live picture stands for B if `frame_b` is None. The
    labels stand beside the line of a wipe."""
    _pairs[scene.session_uid] = Pair(frame_a, frame_b, labels)
    scene.relume_view.compare = mode
    redraw()


def clear(scene: bpy.types.Scene) -> None:
    """Back to the live picture alone."""
    if _pairs.pop(scene.session_uid, None):
        redraw()


def pair_of(scene: bpy.types.Scene) -> Pair | None:
    """Pair of pictures that is compared; None if there is none."""
    return _pairs.get(scene.session_uid)


def frames() -> list[Any]:
    """All frames in use."""
    return [frame for pair in _pairs.values() for frame in (pair.a, pair.b) if frame is not None]


def free() -> None:
    """Forgets all pairs."""
    _pairs.clear()
