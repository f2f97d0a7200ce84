"""Blender is quit while lights are learned and another Blender renders for it. Before that, an undo while they are
learned."""

import bpy
from artist import Artist, addon, will_ask_again

NEEDS = ["demo.blend"]


def play(driver):
    """See the first lines of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (192, 108), samples=4, train_seconds=600)
        artist.scene.relume.folder = str(driver.scratch / "bake")

    with driver.step("undo while lights are learned"):
        yield from driver.press_button("relume.start")
        yield from driver.until(
            lambda: artist.shot and artist.state == "training" and artist.shot.frame, artist.words, 120
        )
        before = tuple(artist.scene.objects["Lamp"].location)
        yield from artist.select("Lamp")
        yield from artist.drag(100)
        yield from artist.undo()
        driver.check(tuple(artist.scene.objects["Lamp"].location) == before, "undo puts the light back")
        yield from driver.until(lambda: artist.shot.present_frame and not will_ask_again(), artist.words, 60)
        driver.check(artist.state == "training", f"learning goes on: {artist.words()}")
        driver.photo("learning")

    with driver.step("at work"):
        artist.scene.relume_verify.samples = 60_000
        bpy.ops.relume.verify()
        yield from driver.wait(2.0)
        driver.check(addon("engine.cycles.verify").of(artist.scene).is_running, "the other Blender renders")
        driver.check(artist.state == "training", f"learning goes on: {artist.words()}")
        driver.photo("at work")
