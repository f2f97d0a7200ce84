"""An artist relights fog, skin and hair."""

from visit import visit

NEEDS = ["creature.blend"]


def play(driver):
    """See the first line of this file."""
    yield from visit(driver, "creature.blend", (192, 108), ("Key", "Fill", "Rim"), pixels=200)
