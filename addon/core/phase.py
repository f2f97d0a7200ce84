"""Phases of a shot: from the reading of its scene to its end."""

from __future__ import annotations

from enum import StrEnum


class ShotPhase(StrEnum):
    """Phase of a shot. Those from `PREPARING` to `FAILED` are the states of `relume.LiveStatus`."""

    READING = "reading"
    """Blender reads the scene, or is about to."""
    INTERRUPTED = "interrupted"
    """Reading was stopped; the bake of before is to be shown again."""
    UNREAD = "unread"
    """Reading was stopped or failed, and there is no bake to show."""
    PREPARING = "preparing"
    """Trees and textures of the scene are made, or files are opened."""
    BAKING = "baking"
    """Paths are traced."""
    TRAINING = "training"
    """A proxy is trained."""
    READY = "ready"
    """All is done."""
    CANCELLED = "cancelled"
    """Baking or training was stopped."""
    FAILED = "failed"
    """Baking or training failed."""
    CLOSED = "closed"
    """The shot has ended."""


_ENDS = {ShotPhase.READY, ShotPhase.CANCELLED, ShotPhase.FAILED}
_WORK = {ShotPhase.BAKING, ShotPhase.TRAINING}
NEXT: dict[ShotPhase, set[ShotPhase]] = {
    ShotPhase.READING: {ShotPhase.PREPARING, ShotPhase.INTERRUPTED, ShotPhase.UNREAD},
    ShotPhase.INTERRUPTED: {ShotPhase.UNREAD},
    ShotPhase.UNREAD: set(),
    ShotPhase.PREPARING: _WORK | _ENDS,
    ShotPhase.BAKING: {ShotPhase.TRAINING} | _ENDS,
    # Kinds of light are learned from the first samples, then the rest is traced.
    ShotPhase.TRAINING: {ShotPhase.BAKING} | _ENDS,
    ShotPhase.READY: {ShotPhase.TRAINING, ShotPhase.CANCELLED, ShotPhase.FAILED},  # A kind of light came into use.
    ShotPhase.CANCELLED: set(),
    ShotPhase.FAILED: set(),
    ShotPhase.CLOSED: set(),
}
"""Phases that may follow each one, beside `CLOSED`, which may follow all. A poll may miss short ones in between."""
TRACING = {ShotPhase.READING, ShotPhase.PREPARING, ShotPhase.BAKING}
WORKING = TRACING | {ShotPhase.TRAINING}
BEFORE_BAKE = {ShotPhase.READING, ShotPhase.INTERRUPTED, ShotPhase.UNREAD}
"""Phases in which the native module has nothing of the shot."""


class IllegalPhaseError(Exception):
    """A phase that cannot follow the present one."""


def next_phase(present: ShotPhase, new: ShotPhase) -> ShotPhase:
    """The new phase. Raises IllegalPhaseError if it may not follow the present one."""
    if new != present and new is not ShotPhase.CLOSED and new not in NEXT[present]:
        raise IllegalPhaseError(f"a shot that is {present} cannot become {new}")
    return new
