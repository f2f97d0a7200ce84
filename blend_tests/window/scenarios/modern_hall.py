"""An artist relights a hall with eight area lights and five emissive meshes, without waiting for all samples."""

from artist import visit

NEEDS = ["modern_hall.blend"]


def play(driver):
    """See the first line of this file."""
    yield from visit(driver, "modern_hall.blend", (960, 540), "light_0", patient=False)
