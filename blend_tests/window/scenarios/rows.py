"""Rows appear by themselves, are worked by hand, applied and undone; looks come back."""

import bpy

NEEDS = ["demo.blend"]


def row(name):
    """The row of a light."""
    return next(row for row in bpy.context.scene.relume_mix.rows if row.present and row.name == name)


def undo(driver):
    """As Ctrl+Z in the view does."""
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
        yield from driver.drawn()
        there = {row.name for row in bpy.context.scene.relume_mix.rows if row.present}
        driver.check(first not in there, "its row is gone")
        yield from undo(driver)
        driver.check(row(first).multiplier == 2.0, "undo brings it back with its values")

    with driver.step("looks"):
        yield from press_button(driver, "bpy.ops.relume.snapshot")
        driver.check(len(bpy.context.scene.relume_looks.items) == 1, "a snapshot")
        row(first).multiplier = 7.0
        yield from press_button(driver, "bpy.ops.relume.restore_look")
        driver.photo("looks")
        driver.check(row(first).multiplier == 2.0, "the look is back")
