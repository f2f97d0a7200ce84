"""Larger shots: whether the window goes on while they are read, baked, learned, edited whole, saved and verified."""

import bpy
from artist import Artist, addon

NEEDS = ["kitchen.blend", "coffee_maker.blend", "classroom.blend"]
BY_NAME = True
MOVED = 150
"""Objects that are edited at once: fewer than are taken as an edit of the whole scene."""


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    for blend in NEEDS:
        yield from visit(driver, artist, blend)


def visit(driver, artist, blend):
    """From Start to Verify."""
    name = blend.removesuffix(".blend")
    with driver.step(f"{name}: open"):
        yield from artist.open(blend, (320, 180), samples=8, train_seconds=2)
    with driver.step(f"{name}: start"):
        yield from artist.start()
        yield from artist.until_settled()
        driver.photo(f"{name}-settled")
        driver.check(artist.state == "ready", f"baked and learned: {artist.words()}")
    light = next((obj.name for obj in artist.scene.objects if obj.type == "LIGHT" and obj.visible_get()), None)
    if light is not None:
        with driver.step(f"{name}: drag and undo"):
            yield from artist.select(light)
            yield from artist.drag(100)
            yield from artist.until_settled()
            driver.photo(f"{name}-dragged")
            yield from artist.undo()
            yield from artist.until_settled()
    meshes = [obj.name for obj in artist.scene.objects if obj.type == "MESH"]
    for what, names in (("some objects are moved", meshes[:MOVED]), ("all objects are moved", meshes)):
        with driver.step(f"{name}: {what}"):
            for each in names:
                artist.scene.objects[each].location.z += 0.01
            bpy.ops.ed.undo_push(message="Move")
            yield from driver.drawn()
            yield from looked_at(driver, artist)
            driver.check(artist.shot.changes.sentences, "it is said")
            yield from artist.undo()
            yield from looked_at(driver, artist)
    with driver.step(f"{name}: save"):
        bpy.ops.wm.save_mainfile()
        yield from driver.drawn()
    with driver.step(f"{name}: verify"):
        artist.scene.relume_verify.samples = 2
        bpy.ops.relume.verify()
        found = addon("engine.cycles.verify").of(artist.scene)
        yield from driver.until(lambda: not found.is_running, "the render by Cycles", 600)
        driver.check(found.result is not None, f"it is verified: {found.error}")


def looked_at(driver, artist):
    """Waits until the scene was compared with its bake, and the view shows the present picture."""
    yield from artist.until_settled()
    yield from driver.until(lambda: not artist.shot.changes.is_pending, "what has changed", 300)
