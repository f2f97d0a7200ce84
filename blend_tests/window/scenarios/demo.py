"""An artist relights the demo's shot."""

from visit import visit

NEEDS = ["demo.blend"]


def play(driver):
    """See the first line of this file."""
    yield from visit(driver, "demo.blend", (192, 108), ("Key", "Lamp", "Lamp"), pixels=200)
