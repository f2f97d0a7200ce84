"""How long Python's lock is held at a time while a shot is read: Blender's window waits where it has Python to run."""

import threading
import time

import bpy
from artist import Artist

NEEDS = ["demo.blend"]
BY_NAME = True
LEVELS = (2, 4, 5)
"""Of subdivision: each has four times as many faces as the one before it."""


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
    waiting = Waiting()
    modifiers = (modifier for obj in artist.scene.objects for modifier in obj.modifiers)
    subdivision = next(modifier for modifier in modifiers if modifier.type == "SUBSURF")
    for level in LEVELS:
        with driver.step(f"subdivided {level} times"):
            subdivision.render_levels = level
            bpy.ops.ed.undo_push(message="Subdivide")
            yield from artist.until_settled()
            waiting.take()
            yield from artist.rebake()
            driver.record(f"longest wait for Python's lock, {level} times", waiting.take() * 1000, "ms")
            driver.check(artist.shot.frame, "there is a picture")
            yield from artist.until_settled()
