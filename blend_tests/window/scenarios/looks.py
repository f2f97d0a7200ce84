"""Looks have thumbnails of their pictures and are compared in the camera's frame: wipe, A, B and difference."""

import bpy
import numpy as np
from artist import addon, settled

NEEDS = ["demo.blend"]


def row(name):
    """A row of the mix."""
    return next(row for row in bpy.context.scene.relume_mix.rows if row.present and row.name == name)


def snapshot(driver, name):
    """A look of the settled picture."""
    yield from settled(driver)
    bpy.ops.relume.snapshot()
    look = bpy.context.scene.relume_looks.items[-1]
    look.name = name
    thumbnail = addon("ui.thumbnails").decode(look.thumbnail)
    driver.check(thumbnail.max() > 100 and np.ptp(thumbnail) > 50, f"{name} has a thumbnail with something in it")
    return thumbnail.astype(float).mean(axis=(0, 1))


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    yield from driver.look_through_camera()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 160, 90, 100
    scene.relume.quality, scene.relume.samples = "CUSTOM", 4
    scene.relume.folder = str(driver.scratch / "bake")
    addon("engine.shot.options").preferences().train_seconds = 0.0
    yield from driver.show_tab("Relume")
    with driver.step("start"):
        bpy.ops.relume.start()
        found = addon("engine.shot.shot").of(scene)
        yield from driver.until(lambda: found.frame is not None, "the first picture", 300)
        yield from driver.until(lambda: addon("viewport.view_table").of(scene) is not None, "the view's colours", 60)

    with driver.step("snapshots"):
        neutral = yield from snapshot(driver, "Neutral")
        row("Key").color, row("Key").exposure = (0.1, 0.2, 1.0), 1.0
        blue = yield from snapshot(driver, "Blue")
        driver.check(blue[2] / blue[0] > 1.2 * neutral[2] / neutral[0], f"Blue is bluer: {blue} after {neutral}")
        yield from driver.drawn()
        driver.photo("thumbnails")

    with driver.step("compare"):
        scene.relume_looks.active, scene.relume_looks.other = 0, "Blue"
        bpy.ops.relume.compare_looks()
        pair_of = addon("viewport.compare").pair_of
        yield from driver.until(lambda: pair_of(scene) is not None, "both pictures", 300)
        screens, scene.relume_view.difference_gain = {}, 1.0
        for mode in ("WIPE", "A", "B", "DIFFERENCE"):
            scene.relume_view.compare = mode
            yield from driver.drawn()
            screens[mode] = driver.photo(mode.lower()).astype(float).mean(axis=(0, 1))
        driver.check(screens["B"][2] > screens["A"][2], "B is the blue one")
        driver.check(screens["DIFFERENCE"].sum() < screens["A"].sum(), "the difference is darker than either")
        bpy.ops.relume.stop_comparing()
        driver.check(pair_of(scene) is None, "the live picture alone again")

    with driver.step("restore"):
        scene.relume_looks.active = 0
        bpy.ops.relume.restore_look()
        driver.check(row("Key").exposure == 0.0, "the row of the look")
        yield from settled(driver)
        driver.photo("restored")
