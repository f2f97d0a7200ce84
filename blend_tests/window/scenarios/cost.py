"""What of the window's time is Relume's own: the same steps of Blender with and without it."""

import statistics
import time
from itertools import product

import bpy
from artist import Artist, addon

NEEDS = ["modern_hall.blend"]
BY_NAME = True
ROUNDS = 8


class Nothing(bpy.types.RenderEngine):
    """Renders nothing."""

    bl_idname, bl_label = "RELUME_TEST_NOTHING", "Nothing"

    def render(self, _depsgraph):
        """Called by Blender."""


def record(driver, name, seconds):
    """The median of several times."""
    driver.record(name, statistics.median(seconds) * 1000, "ms")


def timed(work):
    """Seconds of a call."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def render_operator(driver):
    """Blender's own operator that begins a render: Start reads the scene in one."""
    render, view = bpy.context.scene.render, bpy.context.preferences.view
    before = render.engine, view.render_display_type
    bpy.utils.register_class(Nothing)
    render.engine, view.render_display_type = Nothing.bl_idname, "NONE"
    seconds = []
    for _ in range(ROUNDS):
        with bpy.context.temp_override(window=driver.window):
            seconds.append(timed(lambda: bpy.ops.render.render("INVOKE_DEFAULT")))
        yield from driver.wait(0.2)
        yield from driver.until(lambda: not bpy.app.is_job_running("RENDER"), "the end of a render")
    render.engine, view.render_display_type = before
    bpy.utils.unregister_class(Nothing)
    driver.record("Blender's render operator, first time, without Relume", seconds[0] * 1000, "ms")
    record(driver, "Blender's render operator, later, without Relume", seconds[1:])


def first_colours(driver):
    """One pixel in a view that nothing was coloured in: Blender reads the files of its colour management."""
    image, view = bpy.data.images.new("one", 1, 1), bpy.context.scene.view_settings
    before, view.view_transform = view.view_transform, "Khronos PBR Neutral"
    path = str(driver.scratch / "one.png")
    seconds = [timed(lambda: image.save_render(path, scene=bpy.context.scene)) for _ in range(2)]
    view.view_transform = before
    bpy.data.images.remove(image)
    driver.record("Blender colours its first pixel in a view, without Relume", seconds[0] * 1000, "ms")
    driver.record("Blender colours another pixel, without Relume", seconds[1] * 1000, "ms")


def programs(driver):
    """What draws pictures, in a text that no driver has on disk; software compiles when it draws."""
    shader = addon("viewport.shader")
    before = shader.FRAGMENT
    shader.FRAGMENT = before.replace("65504.0", f"{65000 + int(time.time()) % 500}.0")
    seconds = timed(shader.first.__wrapped__)
    driver.record("the driver compiles a small program before them", seconds * 1000, "ms", 50)
    for compares, one_to_one, has_table in product((False, True), repeat=3):
        seconds = timed(lambda way=(one_to_one, compares, has_table): shader.show.__wrapped__(*way))
        words = "of two pictures" if compares else "of a picture"
        words += ", a texel for a pixel" * one_to_one + ", by a table" * has_table
        driver.record(f"the driver compiles a program {words}", seconds * 1000, "ms", 50)
    shader.FRAGMENT = before


def save_copy(driver):
    """What Verify and the background bake begin with."""
    path = str(driver.scratch / "copy.blend")
    seconds = [timed(lambda: bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)) for _ in range(ROUNDS)]
    record(driver, "Blender saves a copy of modern_hall, without Relume", seconds)


def redraws(driver, name, kinds):
    """From asking for regions of the 3D view until the window is shown with them."""
    seconds = []
    for _ in range(ROUNDS):
        drawn = []
        handler = bpy.types.SpaceView3D.draw_handler_add(
            lambda drawn=drawn: drawn.append(1), (), "WINDOW", "POST_PIXEL"
        )
        start = time.perf_counter()
        for region in driver.view.regions:
            if region.type in kinds:
                region.tag_redraw()
        yield from driver.until(lambda drawn=drawn: drawn, "a redraw")
        yield  # Comes when the window is shown.
        seconds.append(time.perf_counter() - start)
        bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
        yield from driver.wait(0.1)
    record(driver, f"redraw of the 3D view, {name}", seconds)


def strength_edits(artist, light):
    """A strength edit in its parts: what Relume computes, and what Blender takes to show it."""
    driver, shot = artist.driver, artist.shot
    asked, computed, shown = [], [], []
    for number in range(1, ROUNDS + 1):
        before = shot.frame.serial
        asked.append(timed(lambda: setattr(artist.row(light), "exposure", 0.1 * number)))  # noqa: B023
        start = time.perf_counter()
        while shot._live.frame(before) is None:
            time.sleep(0.0005)
        computed.append(time.perf_counter() - start)
        start = time.perf_counter()
        yield from driver.until(lambda: artist.serial_drawn > before, "the edit")  # noqa: B023
        yield
        shown.append(time.perf_counter() - start)
        yield from driver.wait(1.0)
    record(driver, "strength edit: the request", asked)
    driver.record("strength edit: the native part", statistics.median(computed) * 1000, "ms", 16)
    record(driver, "strength edit: until Blender shows it", shown)


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    yield from artist.open("modern_hall.blend", (960, 540), samples=4, train_seconds=0)
    yield from driver.wait(2)
    with driver.step("Blender alone"):
        yield from render_operator(driver)
        first_colours(driver)
        programs(driver)
        save_copy(driver)
        yield from redraws(driver, "nothing baked", {"WINDOW"})
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
        view_table = addon("viewport.view_table")
        yield from driver.until(lambda: view_table.is_complete(artist.scene), "the table of the view", 120)
        yield from driver.wait(2)
    with driver.step("redraws"):
        yield from redraws(driver, "with the picture", {"WINDOW"})
        yield from redraws(driver, "with the picture and the panel", {"WINDOW", "UI"})
        artist.scene.relume_view.shown = False
        yield from redraws(driver, "with the picture switched off", {"WINDOW"})
        artist.scene.relume_view.shown = True
        yield from driver.drawn()
    with driver.step("strength edits"):
        yield from strength_edits(artist, "light_0")
        driver.check(artist.state == "ready", f"nothing else was at work: {artist.words()}")
