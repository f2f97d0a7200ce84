"""Sixteen lamps in nested collections: their names are readable in the list at the default width of the side bar."""

import bpy

NEEDS = ["demo.blend"]
NAMES = (
    *("Key Window Left", "Key Window Right", "Desk Lamp", "Desk Lamp Bounce", "Ceiling Spot 01", "Ceiling Spot 02"),
    *("Hallway Practical", "Street Sodium", "Moon Fill", "Screen Glow", "Candle 01", "Candle 02", "Rim Left"),
    *("Rim Right", "Car Headlight", "Fridge Light"),
)
RIGS = {"Interior": ("Living Room", "Hallway"), "Exterior": ("Street",), "Character": ("Rim",)}


def build():
    """Collections within collections, one of them with a single lamp."""
    scene, inner = bpy.context.scene, []
    for outer, names in RIGS.items():
        rig = bpy.data.collections.new(outer)
        scene.collection.children.link(rig)
        for name in names:
            inner.append(bpy.data.collections.new(name))
            rig.children.link(inner[-1])
    for number, name in enumerate(NAMES):
        lamp = bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT"))
        lamp.location = (number % 4 - 2.0, number // 4 - 2.0, 2.0)
        inner[-1 if name == "Rim Left" else number % (len(inner) - 1)].objects.link(lamp)


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    build()
    yield from driver.show_tab("Relume")
    yield from driver.find_button("bpy.ops.relume.apply_to_lights")
    yield from driver.drawn()
    driver.photo("list")
    found = {row.name for row in bpy.context.scene.relume_mix.rows if row.present and row.kind == "LIGHT"}
    driver.check(set(NAMES) <= found, f"a row for each lamp; found {sorted(found)}")
