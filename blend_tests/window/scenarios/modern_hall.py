"""An artist relights a hall with eight area lights and five emissive meshes, without waiting for all samples first."""

from visit import visit

NEEDS = ["modern_hall.blend"]


def play(driver):
    """See the first line of this file."""
    lights = ("light_0", "light_0", "light_5")
    yield from visit(driver, "modern_hall.blend", (480, 270), lights, patient=False)
