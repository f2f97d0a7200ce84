"""Esc, pressed on the keyboard of the X server, ends F12, and nothing else."""

import bpy
from artist import Artist
from keyboard import ESCAPE, press

NEEDS = ["demo.blend"]
SIMULATES_EVENTS = False


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (640, 360), samples=100_000, train_seconds=0)
        bpy.context.preferences.view.render_display_type = "NONE"
        artist.scene.render.engine = "RELUME"

    with driver.step("Esc ends F12"):
        with bpy.context.temp_override(window=driver.window):
            bpy.ops.render.render("INVOKE_DEFAULT")
        yield from driver.until(lambda: bpy.app.is_job_running("RENDER"), "the beginning of F12")
        yield from driver.wait(3.0)
        driver.check(bpy.app.is_job_running("RENDER"), "it bakes")
        press(ESCAPE)
        seconds = yield from driver.until(lambda: not bpy.app.is_job_running("RENDER"), "the end of F12", 30)
        driver.record("F12 ends after Esc", seconds, "s")
        yield from driver.drawn()
        driver.photo("after-f12")

    with driver.step("the shot goes on"):
        artist.scene.relume.samples = 4
        bpy.ops.relume.start()
        yield from driver.until(lambda: artist.shot.frame, lambda: f"a picture after all that; {artist.words()}", 120)
        yield from artist.until_settled()
        driver.check(artist.state == "ready", f"ready: {artist.words()}")
