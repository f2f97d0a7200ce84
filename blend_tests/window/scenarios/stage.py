"""An artist relights a moving shot: motion blur, displacement and a gobo."""

from visit import visit

NEEDS = ["stage.blend"]


def play(driver):
    """See the first line of this file."""
    yield from visit(driver, "stage.blend", (256, 144), ("Sky", "Glow", "Leaves"), pixels=60)
