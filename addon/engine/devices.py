"""Graphics cards of this machine, asked for in the background: drivers take their time."""

from __future__ import annotations

from collections import Counter
from typing import Any

from .native import native

ALWAYS = ["auto", "cpu", "gpu"]

_job: Any = None
_names: list[str] = []


def look() -> None:
    """Begins to look for devices."""
    global _job
    if _job is None:
        _job = native().start("devices")


def is_looking() -> bool:
    """True until the list of devices is there; takes it then. Raises RelumeError if listing them failed."""
    global _job, _names
    if _job is None:
        return False
    if not _job.done:
        return True
    job, _job = _job, None
    found = job.result()["devices"]
    count = Counter(device["name"] for device in found)
    place = {True: " at {pci_bus_id}", False: ""}
    _names = [("{name}" + place[count[device["name"]] > 1]).format(**device) for device in found]
    return False


def names() -> list[str]:
    """Names that the device can be set to: always the same three, and the cards that were found."""
    return [*ALWAYS, *_names]
