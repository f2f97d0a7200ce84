"""Rows appear by themselves, are worked by hand, applied and undone; looks come back; 500 lights stay quick."""

import bpy
from mathutils import Color

NEEDS = ["demo.blend"]
MANY = 500


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


def add_many_lights():
    """Collections full of lights."""
    for group in range(20):
        collection = bpy.data.collections.new(f"Street {group:02}")
        bpy.context.scene.collection.children.link(collection)
        for number in range(MANY // 20):
            light = bpy.data.objects.new(f"Lamp {group:02} {number:02}", bpy.data.lights.new("Lamp", "POINT"))
            light.data.color = Color((1.0, 0.8, 0.6))
            collection.objects.link(light)


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

    with driver.step("many lights are added"):
        add_many_lights()
        yield from driver.drawn()
    with driver.step("many lights are listed"):
        yield from driver.show_tab("Relume")
        yield from driver.drawn()
        driver.photo("many")
        present = sum(row.present for row in bpy.context.scene.relume_mix.rows)
        driver.check(present >= MANY, f"at least {MANY} rows; found {present}")
    with driver.step("a slider among many lights"):
        for number in range(20):
            row(first).exposure = number / 10
            yield from driver.drawn()
    with driver.step("a light is dragged among many"):
        for number in range(20):
            bpy.data.objects[first].location.x += 0.01 * number
            yield from driver.drawn()
