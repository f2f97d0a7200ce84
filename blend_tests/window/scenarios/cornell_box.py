"""An artist relights the Cornell box, which has one light."""

from visit import visit

NEEDS = ["cornell_box.blend"]
EVERY_TIME = True


def play(driver):
    """See the first line of this file."""
    yield from visit(driver, "cornell_box.blend", (192, 192), ("light_0", "light_0", "World"))
