"""The state of a shot in words for the artist."""

from __future__ import annotations

import json
from typing import Any

from .phase import TRACING, WORKING, ShotPhase
from .progress import clock, share_and_words
from .shot_status import ShotStatus
from .words import listed

STAGES = {
    "prepare": "Preparing the scene",
    "trace": "Tracing paths",
    "gather": "Summing lights",
    "references": "Making pictures to compare with",
    "train": "Learning the lights",
    "measure": "Measuring what was learned",
    "write": "Writing files",
    "optimise": "Solving",
    "polish": "Polishing",
}


def is_final(frame: Any) -> bool:
    """True if no better frame of the same request is to come."""
    summary = json.loads(frame.summary)
    return frame.scale == 1 and summary.get("settled", True)


def shown(status: ShotStatus) -> str:
    """Description of what the shown picture is made of."""
    picture = status.live.shown
    if picture is None:
        return ""
    makers = set(picture.get("makers", {}).values())
    samples = picture.get("samples", 0)
    plain = f"{samples} {'sample' if samples == 1 else 'samples'}"
    denoised = ", denoised" if picture["denoised"] else ""
    # The figure would be too low where few paths meet a light: pixels that none reaches show no noise.
    if (noise := picture.get("noise")) is not None and not status.live.rarely_met:
        denoised += f" (noise {100 * noise:.0f} %{' before' if denoised else ''})"
    size = f", at 1/{picture['scale']} size" if picture.get("scale", 1) > 1 else ""
    if "proxy" not in makers:
        return f"Showing {plain}{denoised}{size}"
    mixed = f" and {plain}{denoised}" if makers - {"proxy"} else ""
    return f"Showing the proxy{_error(status)}{mixed}{size}"


def _error(status: ShotStatus) -> str:
    """Measured error of the one proxy; of several the largest, as which of them are in use is not told."""
    errors = [proxy["smape"] for proxy in status.live.proxies.values() if proxy.get("smape") is not None]
    limit = "up to " if len(errors) > 1 else ""
    return f" (error {limit}{100 * max(errors):.1f} %)" if errors else ""


def out_of_sight(status: ShotStatus) -> list[str]:
    """Sentence about lights that were moved to where few paths go; none while more paths come."""
    if status.phase in TRACING:
        return []
    names = status.live.rarely_met
    if not names:
        return []
    where = "it is" if len(names) == 1 else "they are"
    return [f"Few paths meet {listed(names)} where {where} now"]


FULL_DISK = ("No space left on device", "os error 112", "Disk quota exceeded")
"""Words in messages of operating systems about a full disk."""


def error(status: ShotStatus) -> str:
    """Error in words for the artist; empty if there is none."""
    text = status.error or ""
    if any(words in text for words in FULL_DISK):
        return "The disk is full: free some space, or choose another bake folder, and Rebake"
    return text


def has_failed(status: ShotStatus) -> bool:
    """True if the headline is an error."""
    return status.phase is ShotPhase.FAILED or (status.phase is ShotPhase.UNREAD and bool(status.error))


def headline(status: ShotStatus) -> str:
    """Summary of the present state in one line."""
    match status.phase:
        case ShotPhase.READING | ShotPhase.PREPARING:
            return "Reading the scene"
        case ShotPhase.BAKING:
            return f"{_doing(status, 'trace')}, {status.live.samples} of {status.samples_total} samples"
        case ShotPhase.TRAINING:
            return _doing(status, "train")
        case ShotPhase.CANCELLED | ShotPhase.INTERRUPTED:
            return _stopped(status)
        case ShotPhase.UNREAD:
            return error(status) or _stopped(status)
        case ShotPhase.FAILED:
            return error(status) or "Relume failed without saying why"
    return _stopped(status) if is_unfinished(status) else f"Ready, {status.live.samples} samples"


def is_unfinished(status: ShotStatus) -> bool:
    """True if something is left to bake or learn and nobody does it: it was stopped, now or before the file was
    opened."""
    return status.phase in {ShotPhase.CANCELLED, ShotPhase.READY} and (status.is_incomplete or lacks_samples(status))


def lacks_samples(status: ShotStatus) -> bool:
    """True if there are fewer samples than were asked for."""
    return status.live.samples < status.samples_total


def _stopped(status: ShotStatus) -> str:
    if status.is_incomplete and not lacks_samples(status):
        return f"Stopped while learning the lights; {status.live.samples} samples are kept"
    if not status.live.samples:
        return "Stopped"
    kept = f"Stopped at {status.live.samples} of {status.samples_total} samples; they are kept"
    if status.is_under_another_world:  # Paths of two worlds do not go into one bake.
        return f"{kept}, but Resume traces them anew, as the world has changed since. What was learned stays"
    return kept


def _doing(status: ShotStatus, otherwise: str) -> str:
    stage = (status.stage or {}).get("stage", otherwise)
    return f"{'Paused: ' if status.live.paused else ''}{STAGES.get(stage, stage.capitalize())}"


def progress(status: ShotStatus) -> tuple[float, str] | None:
    """Share that is done and a text, of the present stage; None if nothing runs."""
    stage = status.stage
    if stage is None or status.phase not in WORKING:
        return None
    return share_and_words(stage)


def to_come(status: ShotStatus) -> str:
    """Remaining time of the whole bake in words, where more stages follow the present one; empty if unknown."""
    remaining = status.remaining
    if remaining is None or status.phase not in {ShotPhase.BAKING, ShotPhase.TRAINING}:
        return ""
    about = "About" if remaining.is_complete else "At least"
    return f"{about} {clock(remaining.seconds)} until all is {'traced and ' if remaining.traces else ''}learned"
