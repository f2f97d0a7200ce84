"""A shot with 500 lights: they are read, listed, dragged and dialled while the window goes on."""

import bpy
from artist import WORK_SECONDS, Artist
from mathutils import Color

NEEDS = ["demo.blend"]
GROUPS = 20
EACH = 25


def add_lights(scene):
    """Collections full of small lights over the scene."""
    for group in range(GROUPS):
        collection = bpy.data.collections.new(f"Street {group:02}")
        scene.collection.children.link(collection)
        for number in range(EACH):
            light = bpy.data.objects.new(f"Lamp {group:02} {number:02}", bpy.data.lights.new("Lamp", "POINT"))
            light.location = (0.4 * number - 5.0, 0.4 * group - 4.0, 2.5)
            light.data.color, light.data.energy, light.data.shadow_soft_size = Color((1.0, 0.8, 0.6)), 1.0, 0.2
            collection.objects.link(light)


def until_shown(artist):
    """Waits until the view shows a full picture of the lights and rows as they are, denoised or not; the seconds."""

    def is_shown():
        frame = artist.shot.present_frame
        return frame and frame.scale == 1 and not artist.shot.lights.is_waiting and artist.serial_drawn == frame.serial

    return artist.driver.until(is_shown, lambda: f"the present picture; {artist.words()}", WORK_SECONDS)


def brightness(artist):
    """The mean of the picture."""
    return artist.picture()[..., :3].mean()


def play(driver):
    """See the first line of this file."""
    artist, count = Artist(driver), GROUPS * EACH
    with driver.step("open"):
        yield from artist.open("demo.blend", (240, 136), samples=4, train_seconds=0)
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
        few = brightness(artist)
    first = "Lamp 00 00"
    with driver.step("many lights are added"):
        add_lights(artist.scene)
        bpy.ops.ed.undo_push(message="Lights")
        yield from driver.until(lambda: len(artist.shot.lights.descriptions) >= count, "all lights to be read")
    with driver.step("their picture"):
        seconds = yield from until_shown(artist)
        driver.record(f"time to the picture of {count} more lights", seconds, "s")
        driver.photo("added")
        present = sum(row.present for row in artist.scene.relume_mix.rows)
        driver.check(present >= count + GROUPS, f"a row for each light and collection; found {present}")
        lit = brightness(artist)
        driver.check(lit > 1.2 * few, f"they light the picture: {lit} after {few}")
    with driver.step("one is dragged among many"):
        place = tuple(bpy.data.objects[first].location)
        yield from artist.select(first)
        drawn = len((yield from artist.drag(300)))
        driver.record("pictures drawn while one is dragged, 20 moves of 0.1 s", drawn, "pictures")
        seconds = yield from until_shown(artist)
        driver.record("time from the end of the drag to its picture", seconds, "s")
        driver.photo("dragged")
        driver.check(tuple(bpy.data.objects[first].location) != place, "it was moved")
    with driver.step("undo among many"):
        yield from artist.undo()
        yield from until_shown(artist)
        driver.check(tuple(bpy.data.objects[first].location) == place, "it is back")
    with driver.step("the energy of one is dialled among many"):
        for number in range(5):
            bpy.data.objects[first].data.energy = 1.0 + number
            yield from driver.drawn()
        yield from until_shown(artist)
    with driver.step("a row is dialled among many"):
        for number in range(5):
            seconds = yield from artist.set_exposure(first, 0.1 * (number + 1))
        driver.record(f"overlay after a strength edit among {count} lights", seconds * 1000, "ms")
        yield from until_shown(artist)
    with driver.step("a group is soloed"):
        artist.scene.relume_mix.rows["Street 03"].solo = True
        yield from until_shown(artist)
        driver.photo("soloed")
        driver.check(brightness(artist) < 0.5 * lit, "one street of twenty is darker")
        artist.scene.relume_mix.rows["Street 03"].solo = False
        yield from until_shown(artist)
    with driver.step("one more is added"):
        light = bpy.data.objects.new("One more", bpy.data.lights.new("One more", "POINT"))
        artist.scene.collection.objects.link(light)
        yield from driver.drawn()
        yield from until_shown(artist)
        driver.check("One more" in names(artist), "it is read")
    with driver.step("one is deleted"):
        bpy.data.objects.remove(light)
        yield from driver.drawn()
        yield from until_shown(artist)
        driver.check("One more" not in names(artist) and len(names(artist)) >= count, "it is gone, and no other")


def names(artist):
    """Names of the lights that are read."""
    return {light["name"] for light in artist.shot.lights.descriptions}
