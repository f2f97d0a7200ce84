"""A small lamp of a large hall is moved away from where the paths look, and needs no other bake."""

import bpy
from artist import Artist, addon

NEEDS = ["sponza.blend"]
LAMP = "point"


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("sponza.blend", (320, 180), samples=16, train_seconds=0)
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
        driver.photo("settled")
        driver.check(not missed(artist), f"paths look for the lamps: {artist.words()}")
    with driver.step("move the lamp away"):
        yield from artist.select(LAMP)
        before = artist.shot.frame.serial
        artist.scene.objects[LAMP].location = (-4.0, 1.5, 1.5)
        yield from driver.until(lambda: artist.shot.frame.serial > before, "the picture with the lamp elsewhere")
        yield from artist.until_settled()
        driver.photo("moved")
        before = beside_the_lamp(artist)
        driver.check(not missed(artist), f"its light is connected: {artist.words()}")
    with driver.step("rebake"):
        bpy.ops.relume.rebake()  # No button asks for it.
        yield from driver.until(lambda: artist.shot.is_working, "a new bake")
        yield from artist.until_settled()
        driver.photo("rebaked")
        gain = beside_the_lamp(artist) / before
        driver.record("light beside the lamp after a rebake, of that before", gain, "x")
        driver.check(0.95 < gain < 1.05, f"all of its light was there: {gain:.3f} of what it was")


def missed(artist):
    """Words of the panel about lights that few paths meet."""
    return addon("core.status").out_of_sight(artist.shot.status)


def beside_the_lamp(artist):
    """Mean of the left third of the picture."""
    picture = artist.picture()
    return picture[:, : picture.shape[1] // 3, :3].mean()
