"""A small lamp of a large hall is moved away from where the paths look, and found again."""

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
        dim = beside_the_lamp(artist)
        driver.check(missed(artist) == [f"Few paths meet '{LAMP}' where it is now"], f"it is said: {artist.words()}")
    with driver.step("rebake"):
        yield from driver.press_button("relume.rebake")
        yield from driver.until(lambda: artist.shot.is_working, "a new bake")
        yield from artist.until_settled()
        driver.photo("rebaked")
        driver.check(not missed(artist), f"paths look for the lamp in its new place: {artist.words()}")
        # A lamp that is hardly met is missing rather than noisy: few paths hold all of its light, and denoising removes
        # them.
        gain = beside_the_lamp(artist) / dim
        driver.record("light beside the lamp after a rebake, of that before", gain, "x")
        driver.check(gain > 1.05, f"its light is there: {gain:.3f} of what it was")


def missed(artist):
    """Words of the panel about lights that few paths meet."""
    return addon("core.status").out_of_sight(artist.shot.status)


def beside_the_lamp(artist):
    """Mean of the left third of the picture."""
    picture = artist.picture()
    return picture[:, : picture.shape[1] // 3, :3].mean()
