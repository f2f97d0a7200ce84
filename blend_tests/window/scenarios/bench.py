"""The ten longest calls of the add-on while an artist works: none is above 50 ms on a graphics card."""

import bpy
from calls import Calls
from painter import Painter

NEEDS = ["demo.blend"]
BY_NAME = True
GOAL_MS = 50
SHOWN = 10
LIGHTS = ("Key", "Lamp")


def play(driver):
    """See the first line of this file."""
    artist = Painter(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (480, 270), samples=8, train_seconds=0)
    with Calls() as calls:
        yield from work(driver, artist)
    driver.photo("applied")
    driver.check(not artist.strokes, "what was solved is applied")
    for seconds, name in sorted(calls.found, reverse=True)[:SHOWN]:
        driver.record(name, seconds * 1000, "ms", GOAL_MS)
        print(f"{seconds * 1000:.1f} ms: {name}", flush=True)


def work(driver, artist):
    """Start, drags of lights, a solve, and Apply."""
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
    for light in LIGHTS:
        with driver.step(f"drag {light}"):
            yield from artist.select(light)
            yield from artist.drag(100)
            yield from artist.until_settled()
    with driver.step("solve"):
        with driver.within():
            bpy.ops.wm.tool_set_by_id(name="relume.scribble")
        artist.settings.effort = "QUICK"
        yield from artist.paint("brighter", (0.3, 0.6), (0.7, 0.6))
        yield from artist.solve()
    with driver.step("apply"):
        yield from driver.press_button("relume.apply_solved")
        yield from artist.until_shown()
