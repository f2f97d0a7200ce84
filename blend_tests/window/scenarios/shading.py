"""Whether views that the scene's engine draws go on while a shot is read: Blender ends them where it sees another
engine in the scene."""

import time

from artist import Artist, addon

NEEDS = ["modern_hall.blend"]
BY_NAME = True
ROUNDS = 3
SETTLE_SECONDS = 8
"""Until software has compiled a view's materials."""


def play(driver):
    """See the first line of this file."""
    artist, reading = Artist(driver), addon("engine.reading.render_depsgraph")
    with driver.step("open"):
        yield from artist.open("modern_hall.blend", (240, 136), samples=1, train_seconds=0)
        yield from artist.start()
        yield from artist.until_settled()
    own = reading.standing
    for shading in ("SOLID", "MATERIAL", "RENDERED"):
        with driver.step(shading.lower()):
            space = next(area.spaces.active for area in driver.window.screen.areas if area.type == "VIEW_3D")
            space.shading.type = shading
            yield from driver.wait(SETTLE_SECONDS)
            for engine, words in ((own, "that stands"), (None, "registered for it")):
                reading.standing = engine
                seconds = []
                for _ in range(ROUNDS):
                    seconds.append((yield from longest_turn(artist.rebake())))
                    yield from artist.until_settled()
                    yield from driver.wait(SETTLE_SECONDS)
                name = (
                    f"longest turn of the window while a shot is read by an engine {words}, {shading.lower()} shading"
                )
                driver.record(name, sorted(seconds)[ROUNDS // 2] * 1000, "ms")
            reading.standing = own
            driver.photo(shading.lower())
    driver.check(artist.shot.frame, "there is a picture")


def longest_turn(steps):
    """Plays steps; the longest time between two of them."""
    longest, last = 0.0, time.perf_counter()
    for _ in steps:
        longest, last = max(longest, time.perf_counter() - last), time.perf_counter()
        yield
        longest, last = max(longest, time.perf_counter() - last), time.perf_counter()
    return longest
