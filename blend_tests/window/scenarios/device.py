"""Pictures are made by the card that draws the window, in one process: to Mesa's drivers that is the processor."""

import bpy
import gpu
from artist import Artist, same
from driver import ADDON

NEEDS = ["cornell_box.blend"]


def play(driver):
    """See the first line of this file."""
    artist, preferences = Artist(driver), bpy.context.preferences.addons[ADDON].preferences
    card = gpu.platform.renderer_get().split("/")[0]
    with driver.step("open"):
        preferences.device = "cpu"
        yield from artist.open("cornell_box.blend", (192, 192), samples=4, train_seconds=0)
    with driver.step("on the CPU"):
        yield from artist.start()
        yield from artist.until_settled()
        driver.check("CPU" in artist.shot.status.live.device, f"the CPU makes it: {artist.words()}")
        before = artist.picture()
    with driver.step("on the card"):
        preferences.device = card
        yield from artist.rebake()
        yield from artist.until_settled()
        driver.photo("card")
        driver.check(artist.shot.status.live.device == card, f"{card} makes it: {artist.words()}")
        driver.check(same(artist.picture(), before), "the picture is that of the CPU")
    with driver.step("a light is dragged"):
        yield from artist.select("light_0")
        yield from artist.drag(100)
        yield from artist.until_settled()
        driver.photo("dragged")
        driver.check(not same(artist.picture(), before), "the picture follows")
        yield from artist.undo()
        yield from artist.until_settled()
        driver.check(same(artist.picture(), before), "undo brings it back")
        driver.check(not artist.shot.status.live.warnings, f"the card did all of it: {artist.words()}")
