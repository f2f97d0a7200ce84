"""Actions that nobody planned for, while Relume is at work: a clear word, nothing lost, no crash."""

import os
import time

import bpy
import numpy as np
from artist import Artist, addon, same
from driver import ADDON

NEEDS = ["demo.blend"]
EVERY_TIME = True
FIRST = True
SAMPLES = 4096
"""More than are traced in the time of a scenario."""


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (192, 108), samples=SAMPLES, train_seconds=2)
    steps = (no_camera, not_through_the_camera, pause, save, undo, second_window, delete, another_file)
    for step in (*steps, read_only, full_disk, disable):
        with driver.step(step.__name__.replace("_", " ")):
            yield from step(driver, artist)


def no_camera(driver, artist):
    """Start says what is missing."""
    camera, artist.scene.camera = artist.scene.camera, None
    yield from refused(driver, artist, "has no camera; add one")
    artist.scene.camera = camera
    yield from driver.drawn()


def refused(driver, artist, words):
    """Start is pressed and does nothing but say why."""
    driver.expect_error(words)
    yield from driver.press_button("relume.start")
    yield from driver.drawn()
    driver.photo(words.split()[-1])
    yield from driver.press("ESC")  # Closes the message over the button.
    driver.check(artist.shot is None, f"nothing was started: {words}")
    driver.check(any(words in line for line in driver.errors_shown()), f"Blender shows: {words}")


def not_through_the_camera(driver, artist):
    """The picture waits in the camera view, and a button leads there."""
    with driver.within():
        bpy.ops.view3d.view_axis(type="FRONT")
    driver.view.spaces.active.region_3d.view_perspective = "PERSP"
    yield from driver.show_tab("Relume")
    yield from driver.press_button("relume.start")
    yield from driver.until(lambda: artist.shot and artist.shot.frame, lambda: f"a picture; {artist.words()}", 120)
    driver.photo("not-through-the-camera")
    yield from driver.press_button("relume.look_through_camera")
    yield from driver.drawn()
    driver.check(driver.view.spaces.active.region_3d.view_perspective == "CAMERA", "the button leads to the camera")
    yield from driver.until(lambda: artist.serial_drawn, "the picture in the view")


def pause(driver, artist):
    """Tracing stands still, relighting does not."""
    yield from driver.press_button("relume.pause")
    yield from driver.until(lambda: artist.shot.status.live.paused, "the pause")
    yield from stands_still(driver, artist)
    samples = artist.shot.status.live.samples
    yield from artist.set_exposure("Key", 1.0)
    yield from driver.wait(1)
    driver.photo("paused")
    driver.check(artist.shot.status.live.samples == samples, "nothing is traced while paused")
    yield from driver.press_button("relume.pause")
    yield from grows(driver, artist)


def stands_still(driver, artist):
    """Waits until nothing was traced for three seconds; on a busy machine running samples may end seconds later."""
    samples, since = None, time.perf_counter()

    def is_still():
        nonlocal samples, since
        if artist.shot.status.live.samples != samples:
            samples, since = artist.shot.status.live.samples, time.perf_counter()
        return time.perf_counter() > since + 3

    return driver.until(is_still, artist.words)


def grows(driver, artist):
    """The bake goes on: lights are learned between its passes too."""
    samples = artist.shot.status.live.samples
    yield from driver.until(
        lambda: artist.shot.status.live.samples > samples, lambda: f"more samples; {artist.words()}", 120
    )
    driver.check(artist.state in {"baking", "training"}, f"at work: {artist.words()}")


def save(driver, artist):
    """Ctrl S in the middle of a bake."""
    region = driver.region()
    yield from driver.move_mouse(region.x + region.width / 2, region.y + region.height / 2)
    yield from driver.press("S", ctrl=True)
    yield from driver.until(lambda: not bpy.data.is_dirty, "the file is saved")
    yield from grows(driver, artist)


def undo(driver, artist):
    """A light is moved and put back while paths are traced."""
    before = tuple(artist.scene.objects["Lamp"].location)
    yield from artist.select("Lamp")
    yield from artist.drag(100)
    yield from artist.undo()
    driver.check(tuple(artist.scene.objects["Lamp"].location) == before, "undo puts the light back")
    yield from grows(driver, artist)


def second_window(driver, artist):
    """Two windows show the picture; one is closed."""
    bpy.ops.wm.window_new_main()
    windows = bpy.context.window_manager.windows
    yield from driver.until(lambda: len(windows) == 2, "a second window")
    yield from driver.wait(1)
    region = driver.region(window=windows[1])
    bottom = driver.window.height - windows[1].y - region.y
    part = np.s_[bottom - region.height : bottom, windows[1].x + region.x : windows[1].x + region.x + region.width]
    bright = driver.photo("two-windows")[part].mean()
    yield from artist.set_exposure("Key", -10.0)
    yield from driver.until(lambda: driver.photo()[part].mean() < bright - 5.0, "the second window without the light")
    with bpy.context.temp_override(window=windows[1]):
        bpy.ops.wm.window_close()
    yield from driver.until(lambda: len(windows) == 1, "a single window")
    yield from artist.set_exposure("Key", 0.0)
    yield from grows(driver, artist)


def delete(driver, artist):
    """Something of the scene is deleted: that is said, and undone."""
    name = next(obj.name for obj in artist.scene.objects if obj.type == "MESH")
    yield from driver.until(lambda: not artist.shot.changes.is_pending, "what the bake is of", 60)
    bpy.data.objects.remove(artist.scene.objects[name])
    bpy.ops.ed.undo_push(message="Delete")
    yield from driver.until(lambda: any(name in words for words in changes(artist)), lambda: str(changes(artist)))
    driver.photo("deleted")
    yield from artist.undo()
    driver.check(name in artist.scene.objects, "undo brings the object back")
    yield from driver.until(lambda: not changes(artist), lambda: str(changes(artist)))


def changes(artist):
    """Changes since the bake, as the panel says them."""
    return artist.shot.changes.sentences


def another_file(driver, artist):
    """Another file is opened in the middle of the bake, and the first again: its bake is there, as far as it came."""
    bpy.ops.wm.save_mainfile()
    path = bpy.data.filepath
    bpy.ops.wm.read_homefile(app_template="")
    yield from driver.drawn()
    driver.check(addon("engine.shot.shot").all_open() == [], "nothing goes on")
    bpy.ops.wm.open_mainfile(filepath=path)
    yield from driver.drawn()
    yield from driver.until(
        lambda: artist.shot and artist.shot.frame, lambda: f"the bake opened again: {artist.words()}", 60
    )
    yield from artist.until_settled()
    yield from driver.look_through_camera()
    driver.check(0 < artist.shot.status.live.samples < SAMPLES, f"what was traced is there: {artist.words()}")
    before = artist.picture()
    yield from artist.set_exposure("Key", 1.0)
    yield from artist.set_exposure("Key", 0.0)
    yield from artist.until_settled()
    driver.check(same(artist.picture(), before), "the same picture")
    artist.shot.close()


def read_only(driver, artist):
    """A folder that cannot be written to."""
    if os.path.ismount(folder := driver.scratch.parent / "read_only"):
        artist.scene.relume.folder = str(folder / "bake")
        yield from driver.show_tab("Relume")
        yield from refused(driver, artist, "is read-only")
    else:
        driver.skip("a read-only folder: no right to mount")


def full_disk(driver, artist):
    """A disk that is full in the middle of the bake."""
    if not os.path.ismount(folder := driver.scratch.parent / "small"):
        driver.skip("a full disk: no right to mount")
        return
    artist.scene.relume.folder = str(folder / "bake")
    # The disk has room for one sample and a part of the next. A thread alone writes them in turn; of several, one may
    # write all of the second while another, which Linux lets wait, is at its first part of the first.
    bpy.context.preferences.addons[ADDON].preferences.threads = 1
    bpy.ops.relume.start()
    yield from driver.until(lambda: artist.state not in {"reading", "preparing", "baking"}, artist.words, 120)
    driver.photo("full-disk")
    error = artist.shot.status.error or ""
    driver.check("space" in error or "full" in error, f"the disk is full is said: {artist.words()}")
    # They may be traced before the first picture of them is made.
    yield from driver.until(lambda: artist.shot.frame, lambda: f"the samples that fitted; {artist.words()}", 60)
    yield from artist.set_exposure("Key", 1.0)
    driver.photo("full-disk-relit")


def disable(driver, artist):
    """The add-on is switched off in the middle of a bake; what it wrote is whole."""
    folder = driver.scratch / "last"
    artist.scene.relume.folder = str(folder)
    yield from artist.rebake()
    artist.leave()
    bpy.ops.preferences.addon_disable(module=ADDON)
    yield from driver.drawn()
    yield from driver.until(lambda: not list(folder.glob("**/*.part")), "no half-written file")
    driver.check((folder / "manifest.json").exists(), "the bake is whole")
