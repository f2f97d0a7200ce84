"""Rows appear by themselves, are worked by hand, applied and undone; looks come back. A group locks its lights."""

import bpy

NEEDS = ["demo.blend"]
LOCK_ACROSS = 0.79
"""Where the locks of rows are in the width of the side bar."""


def row(name):
    """The row of a light."""
    return next(row for row in bpy.context.scene.relume_mix.rows if row.present and row.name == name)


def undo(driver):
    """Undoes as Ctrl+Z in the view does."""
    with driver.within():
        bpy.ops.ed.undo()
    yield from driver.drawn()


def press_button(driver, command):
    """Clicks a button of the tab."""
    yield from driver.press_button(command)
    yield from driver.drawn()


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    lights = sorted(obj.name for obj in bpy.context.scene.objects if obj.type == "LIGHT")
    first = lights[0]

    with driver.step("rows by themselves"):
        yield from driver.show_tab("Relume")
        yield from driver.find_button("bpy.ops.relume.apply_to_lights")
        driver.photo("appeared")
        found = sorted(row.name for row in bpy.context.scene.relume_mix.rows if row.present and row.kind == "LIGHT")
        driver.check(found == lights, f"a row for each of {lights}; found {found}")

    with driver.step("apply and undo"):
        energy = bpy.data.objects[first].data.energy
        row(first).multiplier = 2.0
        bpy.ops.ed.undo_push(message="Multiplier")
        yield from driver.drawn()
        driver.photo("dialled")
        yield from press_button(driver, "bpy.ops.relume.apply_to_lights")
        driver.check(abs(bpy.data.objects[first].data.energy / energy - 2.0) < 1e-5, "the light has twice the energy")
        driver.check(row(first).multiplier == 1.0, "its row is neutral")
        yield from undo(driver)
        driver.check(bpy.data.objects[first].data.energy == energy, "one undo brings the energy back")
        driver.check(row(first).multiplier == 2.0, "and the row")

    with driver.step("delete a light and undo"):
        with driver.within():
            bpy.ops.object.select_all(action="DESELECT")
            bpy.ops.relume.select_light(light=first)
            bpy.ops.object.delete()
            bpy.ops.ed.undo_push(message="Delete")
        rows = bpy.context.scene.relume_mix.rows
        yield from driver.until(lambda: not any(row.name == first and row.present for row in rows), "its row to go")
        yield from undo(driver)
        driver.check(row(first).multiplier == 2.0, "undo brings it back with its values")

    with driver.step("looks"):
        yield from press_button(driver, "bpy.ops.relume.snapshot")
        driver.check(len(bpy.context.scene.relume_looks.items) == 1, "a snapshot")
        row(first).multiplier = 7.0
        yield from press_button(driver, "bpy.ops.relume.restore_look")
        driver.photo("looks")
        driver.check(row(first).multiplier == 2.0, "the look is back")

    with driver.step("lock of a group"):
        rig, scene = bpy.data.collections.new("Rig"), bpy.context.scene
        scene.collection.children.link(rig)
        for name in lights[:2]:
            rig.objects.link(bpy.data.objects[name])
            scene.collection.objects.unlink(bpy.data.objects[name])
        bpy.ops.ed.undo_push(message="Rig")
        yield from driver.drawn()
        yield from driver.press_button("bpy.ops.relume.lock_group", LOCK_ACROSS)
        yield from driver.drawn()
        driver.photo("group")
        locked = {name: row(name).locks.locked for name in lights}
        driver.check(locked == {name: name in lights[:2] for name in lights}, f"its lights are locked: {locked}")
        yield from undo(driver)
        driver.check(not any(row(name).locks.locked for name in lights), "one undo opens them again")
