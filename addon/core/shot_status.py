"""Status of a shot: that of the native module, and what the add-on adds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from .phase import ShotPhase


class Eta(NamedTuple):
    """Remaining time of a bake in which more stages follow the present one."""

    seconds: float
    is_complete: bool
    """True if every remaining part has a known pace; otherwise it takes longer than `seconds`."""
    traces: bool
    """True if paths are still to be traced."""


@dataclass(frozen=True)
class ShotStatus:
    """State of a shot at one moment."""

    live: Any
    """`relume.LiveStatus`; that of a shot without a bake until there is one."""
    phase: ShotPhase
    error: str | None = None
    """Reason why reading or work has failed."""
    samples_total: int = 0
    """Paths per pixel of the goal."""
    stage: dict[str, Any] | None = None
    """Progress of the present stage, `relume.StageProgress`."""
    remaining: Eta | None = None
    is_incomplete: bool = False
    """True if the bake does not meet its goal yet."""
    is_under_another_world: bool = False
    """True if paths are missing that cannot be added, since those in the folder are of another world."""
