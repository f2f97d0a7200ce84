"""How long Python's lock is held at a time while a shot is read: Blender's window waits where it has Python to run."""

import threading
import time

import bmesh
import bpy
from artist import Artist, addon

NEEDS = ["demo.blend"]
LEVELS = (2, 4, 5)
"""Of subdivision: each has four times as many faces as the one before it."""
BALL_SUBDIVISIONS = 5
GOAL_MS = 50


class Waiting:
    """The longest time that a thread waits for Python's lock, beyond what it sleeps."""

    SLEEP_SECONDS = 0.001

    def __init__(self):
        self._longest = 0.0
        threading.Thread(target=self._run, daemon=True).start()

    def take(self):
        """Seconds since this was asked the last time."""
        longest, self._longest = self._longest, 0.0
        return longest

    def _run(self):
        while True:
            begun = time.perf_counter()
            time.sleep(self.SLEEP_SECONDS)
            self._longest = max(self._longest, time.perf_counter() - begun - self.SLEEP_SECONDS)


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (192, 108), samples=1, train_seconds=0)
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
    obj = next(obj for obj in artist.scene.objects if any(modifier.type == "SUBSURF" for modifier in obj.modifiers))
    subdivision = next(modifier for modifier in obj.modifiers if modifier.type == "SUBSURF")
    waiting = Waiting()
    for level in LEVELS:
        subdivision.render_levels = level
        yield from rebake(driver, artist, waiting, f"subdivided {level} times")
    shape = obj.data
    obj.data, subdivision.render_levels = ball(), 1
    yield from rebake(driver, artist, waiting, f"{len(obj.data.polygons)} triangles subdivided once")
    obj.data, subdivision.render_levels = shape, level
    driver.check(addon("engine.workers.helper").shared().is_running, "another Blender has subdivided")
    obj.modifiers.new("Triangles", "TRIANGULATE")
    obj.data.shade_smooth()
    yield from rebake(driver, artist, waiting, f"subdivided {level} times and changed after it")


def ball():
    """A ball of triangles: a limit surface that is regular nowhere."""
    mesh, shape = bpy.data.meshes.new("Ball"), bmesh.new()
    bmesh.ops.create_icosphere(shape, subdivisions=BALL_SUBDIVISIONS, radius=1.0)
    shape.to_mesh(mesh)
    shape.free()
    return mesh


def rebake(driver, artist, waiting, what):
    """Reads the shot anew after an edit."""
    with driver.step(what):
        bpy.ops.ed.undo_push(message=what)
        yield from artist.until_settled()
        waiting.take()
        yield from artist.rebake()
        driver.record(f"longest wait for Python's lock, {what}", waiting.take() * 1000, "ms", GOAL_MS)
        driver.photo(what.replace(" ", "-"))
        driver.check(artist.shot.frame, "there is a picture")
        yield from artist.until_settled()
