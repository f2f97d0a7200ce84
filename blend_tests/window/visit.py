"""An artist's visit to a shot, from Start to the add-on switched off; the same for every scene."""

import bpy
from artist import Artist, addon, brighten, drag_and_undo, same
from calls import Calls
from driver import ADDON

MANY_SAMPLES = 512
"""More than are traced until somebody finds the button that cancels."""


def visit(driver, blend, size, lights, pixels=100, patient=True):
    """Relights a shot by hand, with mouse and keys where the artist would use them.

    `size`: width and height of the picture. `lights`: names of one whose row is changed, one that is dragged (by
    `pixels`), and one that is heard alone. Without patience the first bake is cancelled in the middle, and the shot
    relit from the samples that are there.
    """
    artist = Artist(driver)
    key, dragged, alone = lights
    with driver.step("open"):
        yield from artist.open(blend, size, samples=4 if patient else MANY_SAMPLES, train_seconds=2)
        driver.photo("panel")
    with driver.step("start"):
        yield from artist.start()
        driver.photo("first-picture")
    with driver.step("samples and training" if patient else "cancel the first bake"):
        if not patient:
            yield from driver.press_button("relume.cancel", across=0.7)
        yield from artist.until_settled()
        driver.photo("settled")
        driver.check(artist.state == ("ready" if patient else "cancelled"), f"the end of the bake: {artist.words()}")
        driver.check(bool(artist.proxies()) == patient, f"proxies that have learned: {artist.proxies()}")
    with driver.step("look like the render"):
        yield from artist.compare_with_display("overlay")
    with driver.step("drag and undo"):
        yield from driver.look_through_camera()
        yield from drag_and_undo(artist, dragged, pixels)
    with driver.step("mix"):
        yield from mix(driver, artist, key, alone)
    for step in (take_a_snapshot, apply_and_undo, reopen, cancel):
        with driver.step(step.__name__.replace("_", " ")):
            yield from step(driver, artist, key)
    with driver.step("disable while training"):
        yield from disable_while_training(driver, artist)


def mix(driver, artist, key, alone):
    """Rows change the picture and nothing in the scene; S hears a light alone."""
    before = artist.picture()
    yield from brighten(artist, key)
    driver.photo("brighter")
    brighter, button = artist.picture(), artist.row_button(alone, "solo")
    yield from driver.press_button(*button)
    driver.check(artist.row(alone).solo, "S was pressed")
    yield from artist.until_settled()
    driver.photo("solo")
    driver.check(artist.picture().mean() < before.mean(), "one light alone is darker than all")
    yield from driver.press_button(*button)
    driver.check(not artist.row(alone).solo, "S was pressed again")
    yield from artist.until_settled()
    driver.check(same(artist.picture(), brighter), "without solo all lights are back")


def take_a_snapshot(driver, artist, key):
    """A look is kept with its thumbnail, and put back."""
    looks, before = artist.scene.relume_looks.items, artist.picture()
    yield from driver.press_button("relume.snapshot")
    yield from driver.until(lambda: len(looks) == 1 and looks[0].thumbnail, "a look with its thumbnail")
    driver.photo("snapshot")
    yield from driver.press_button(*artist.row_button(key, "on"))
    driver.check(not artist.row(key).on, "the row was switched off")
    yield from artist.until_settled()
    driver.check(not same(artist.picture(), before), "a row that is off changes the picture")
    yield from driver.press_button("relume.restore_look(lights=False)")
    yield from artist.until_settled()
    driver.check(artist.row(key).on and artist.row(key).exposure == 1.0, "the look has its rows back")
    driver.check(same(artist.picture(), before), "the look has its picture back")


def apply_and_undo(driver, artist, key):
    """Apply writes the rows into the lights, the picture stays; one undo takes it all back."""
    light, before = bpy.data.objects[key].data, artist.picture()
    energy = light.energy
    yield from driver.press_button("relume.apply_to_lights")
    yield from driver.drawn()
    yield from artist.until_settled()
    driver.photo("applied")
    driver.check(abs(light.energy / energy - 2) < 1e-3, f"a stop doubles the energy: {energy} -> {light.energy}")
    driver.check(artist.row(key).exposure == 0.0, "the row is neutral")
    driver.check(same(artist.picture(), before), "the picture stays")
    yield from artist.undo()
    yield from artist.until_settled()
    driver.check(bpy.data.objects[key].data.energy == energy, "one undo takes the energy back")
    driver.check(artist.row(key).exposure == 1.0, "one undo takes the row back")
    driver.check(same(artist.picture(), before), "the picture stays with undo")


def reopen(driver, artist, key):
    """A saved file finds its bake, proxies, rows and looks."""
    before, was_whole, proxies = artist.picture(), artist.state == "ready", artist.proxies()
    bpy.ops.wm.save_mainfile()
    bpy.ops.wm.open_mainfile(filepath=bpy.data.filepath)
    yield from driver.drawn()
    driver.check(artist.row(key).exposure == 1.0, "rows are in the file")
    driver.check(len(artist.scene.relume_looks.items) == 1, "looks are in the file")
    yield from driver.until(
        lambda: artist.shot and artist.shot.frame, lambda: f"the bake opened again: {artist.words()}", 60
    )
    yield from artist.until_settled()
    yield from driver.look_through_camera()
    driver.photo("reopened")
    driver.check(artist.state == "ready", f"the bake is open: {artist.words()}")
    is_whole = not addon("core.status").is_unfinished(artist.shot.status)
    driver.check(is_whole == was_whole, f"it is as whole as it was: {artist.words()}")
    driver.check(artist.proxies() == proxies, f"its proxies: {artist.proxies()} instead of {proxies}")
    driver.check(same(artist.picture(), before), "the same picture from the file")


def cancel(driver, artist, key):
    """A bake can be stopped in the middle; what is there is kept and can be relit."""
    artist.scene.relume.samples = MANY_SAMPLES
    yield from driver.show_tab("Relume")
    yield from artist.rebake()
    yield from driver.press_button("relume.cancel", across=0.7)
    yield from driver.until(lambda: artist.state == "cancelled", lambda: f"the end of the bake: {artist.words()}")
    yield from artist.until_settled()
    driver.photo("cancelled")
    yield from artist.set_exposure(key, 2.0)


def disable_while_training(driver, artist):
    """Nothing goes on when the add-on is switched off in the middle of its work."""
    # In another folder, because a rebake keeps the networks that were trained before.
    artist.scene.relume.folder = str(driver.scratch / "anew")
    artist.scene.relume.samples = 8
    artist.scene.render.resolution_percentage = 25  # All samples come before the training.
    bpy.context.preferences.addons[ADDON].preferences.train_seconds = 60
    yield from artist.rebake()
    yield from driver.until(lambda: artist.stage == "train", lambda: f"training: {artist.words()}", 120)
    artist.leave()
    bpy.ops.preferences.addon_disable(module=ADDON)
    yield from driver.drawn()
    with Calls() as calls:
        yield from driver.wait(2)
    driver.photo("disabled")
    driver.check(not calls.found, f"nothing of the add-on is called any more: {calls.found}")
    bpy.ops.preferences.addon_enable(module=ADDON)
    yield from driver.drawn()
    driver.check(hasattr(artist.scene, "relume"), "it can be enabled again")
