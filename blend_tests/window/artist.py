"""Actions of an artist on a shot, as functions for scenarios; each is a generator, as scenarios are."""

import importlib
import json
import shutil
import time

import bpy
import numpy as np
from display import in_image_editor, write_exr
from driver import ADDON
from mathutils import Vector

FIRST_PICTURE_SECONDS = 120
WORK_SECONDS = 600
EXPOSURE_ACROSS = 0.66
"""Where the fields of exposure are in the width of the side bar."""
SWITCHES = ["show_gizmo", "show_region_ui", "show_region_toolbar", "show_region_header", "show_region_tool_header"]


def addon(module):
    """A module of the installed add-on, to look at its state: "engine.shot"."""
    return importlib.import_module(f"{ADDON}.{module}")


def will_ask_again():
    """True if a fuller picture of an edit will be asked for a moment later."""
    return bool(addon("live.scheduler").scheduler.settling)


def add_camera(scene, name, right, up):
    """A camera beside the scene's own, looking the same way."""
    camera = scene.camera.copy()
    camera.name = name
    scene.collection.objects.link(camera)
    camera.matrix_world.translation += scene.camera.matrix_world.to_3x3() @ Vector((right, up, 0.0))


def settled(driver):
    """Waits for the full picture of what the scene has now; for scenarios without an artist."""
    yield from driver.drawn()  # What scripts edit is noticed then.
    shot = addon("engine.shot.shot").of(driver.window.scene)

    def is_settled():
        return shot.frame is not None and not shot.is_busy and not will_ask_again()

    yield from driver.until(is_settled, "the settled picture", WORK_SECONDS)
    yield from driver.drawn()


class Artist:
    """An artist with one shot open in a window."""

    def __init__(self, driver):
        self.driver = driver
        self.serial_drawn = 0
        self._handler = bpy.types.SpaceView3D.draw_handler_add(self._note_drawing, (), "WINDOW", "POST_PIXEL")

    def leave(self):
        """Looks no more into the add-on, which may then be disabled."""
        bpy.types.SpaceView3D.draw_handler_remove(self._handler, "WINDOW")

    def _note_drawing(self):
        frame = self.shot and self.shot.frame
        has_view = addon("viewport.view_table").of(self.scene) is not None
        self.serial_drawn = frame.serial if frame and has_view else 0

    @property
    def scene(self):
        """The scene in the window."""
        return self.driver.window.scene

    @property
    def shot(self):
        """Open shot of the scene; None if there is none."""
        return addon("engine.shot.shot").of(self.scene)

    @property
    def state(self):
        """Phase of the shot, in a word."""
        return self.shot and self.shot.status.phase

    @property
    def stage(self):
        """Stage of the work, in a word; None if nothing goes on."""
        stage = self.shot and self.shot.status.stage
        return stage and stage["stage"]

    def proxies(self):
        """Quality of each proxy, as the shot says it."""
        return self.shot.status.live.proxies

    def row(self, name):
        """A row of the mix."""
        return self.scene.relume_mix.rows[name]

    def picture(self):
        """Scene-linear pixels of the newest frame, RGBA [height, width, 4], bottom row first."""
        return np.array(self.shot.frame.image)

    # Waiting

    def until_settled(self, seconds=WORK_SECONDS):
        """Waits until nothing better is to come for the lights as they are, and the view shows it: after a drag on a
        slow machine the picture of half the size is whole a moment before the full one is asked for, and after undo
        lights are read a moment later."""

        def is_settled():
            shot, frame = self.shot, self.shot.frame
            is_done = not (shot.lights.is_forgotten or shot.is_busy or will_ask_again())
            return is_done and frame.scale == 1 and self.serial_drawn == frame.serial

        return self.driver.until(is_settled, lambda: f"the last picture; {self.words()}", seconds)

    def words(self):
        """The state of the shot, for messages."""
        return str(self.shot and self.shot.status)

    # Work

    def open(self, blend, size, samples, train_seconds):
        """Opens a copy of a scene with pictures of width and height `size`, through the camera, with the panel."""
        own = self.driver.scratch / blend
        shutil.copyfile(self.driver.scenes / blend, own)
        bpy.ops.wm.open_mainfile(filepath=str(own))
        yield from self.driver.look_through_camera()
        yield from self.driver.show_tab("Relume")
        bpy.context.preferences.addons[ADDON].preferences.train_seconds = train_seconds
        render = self.scene.render
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        self.scene.relume.quality, self.scene.relume.samples = "CUSTOM", samples
        bpy.ops.ed.undo_push(message="Settings")

    def start(self):
        """Presses Start and waits for the first picture; records the time."""
        place = yield from self.driver.find_button("relume.start")
        start = time.perf_counter()
        yield from self.driver.click(*place)
        yield from self._until_first_picture(None)
        seconds, render = time.perf_counter() - start, self.scene.render
        size = f"{render.resolution_x} x {render.resolution_y}"
        self.driver.record(f"time to the first picture, {size}", seconds, "s")

    def rebake(self):
        """Bakes anew, by the operator (its button is in a panel that is closed), and waits for the first picture."""
        before = self.shot
        with self.driver.within("UI"):
            bpy.ops.relume.rebake()
        yield from self._until_first_picture(before)

    def _until_first_picture(self, before):
        """Waits until the view shows a picture of another shot than `before`."""

        def is_shown():
            shot = self.shot
            return shot and shot is not before and shot.frame and self.serial_drawn == shot.frame.serial

        return self.driver.until(is_shown, lambda: f"the first picture; {self.words()}", FIRST_PICTURE_SECONDS)

    def select(self, name):
        """Makes an object the only one selected."""
        bpy.ops.object.select_all(action="DESELECT")
        self.scene.objects[name].select_set(True)
        self.driver.window.view_layer.objects.active = self.scene.objects[name]
        yield from self.driver.drawn()

    def drag(self, pixels, confirm=True):
        """Moves what is selected to the right, G and the mouse; returns what was drawn on the way, each frame with
        its request."""
        region = self.driver.region()
        x, y = region.x + region.width / 2, region.y + region.height / 2
        yield from self.driver.move_mouse(x, y)
        yield from self.driver.press("G")
        first, requests, drawn = self.serial_drawn, {}, {}
        shot, relight = self.shot, self.shot.relight
        text = addon("engine.shot.requests").request_text

        def noted(lights, mix, interactive, world=None):
            is_new = relight(lights, mix, interactive, world)
            if is_new:
                content = json.loads(text({"lights": lights, **mix}))
                requests[shot._request_number] = content | {"interactive": interactive}
            return is_new

        shot.relight = noted
        for i in range(1, 21):
            yield from self.driver.move_mouse(x + pixels * i / 20, y)
            for _ in self.driver.wait(0.1):
                frame = shot.frame
                if self.serial_drawn == frame.serial > first:
                    drawn[frame.serial] = frame
                yield
        yield from self.driver.press("LEFTMOUSE" if confirm else "ESC")
        del shot.relight
        return [(frame, requests[frame.request]) for frame in drawn.values() if frame.request in requests]

    def row_button(self, name, what):
        """Path and place in the side bar's width of what a row of the list has: "on", "solo" or "exposure"."""
        across = {"on": 0.12, "solo": 0.165, "exposure": EXPOSURE_ACROSS}[what]
        return f"relume_mix.rows[{self.scene.relume_mix.rows.find(name)}].{what}", across

    def set_exposure(self, name, stops):
        """Sets the exposure of a row and waits until the view has drawn it; returns the seconds."""
        before, start = self.shot.frame.serial, time.perf_counter()
        self.row(name).exposure = stops
        yield from self._until_newer(before)
        return time.perf_counter() - start

    def type_exposure(self, name, stops):
        """Types the exposure of a row into its field and waits until the view has drawn it."""
        yield from self.driver.find_button(*self.row_button(name, "exposure"))
        before = self.shot.frame.serial
        yield from self.driver.press("RET")
        yield from self.driver.type(str(stops))
        yield from self.driver.press("RET")
        self.driver.check(self.row(name).exposure == stops, f"it was typed: {self.row(name).exposure}")
        yield from self._until_newer(before)

    def _until_newer(self, serial):
        """Waits until the view has drawn a newer picture than one."""
        return self.driver.until(lambda: self.serial_drawn > serial, lambda: f"a new exposure; {self.words()}")

    def undo(self):
        """Ctrl Z with the mouse over the view."""
        region = self.driver.region()
        yield from self.driver.move_mouse(region.x + region.width / 2, region.y + region.height / 2)
        yield from self.driver.press("Z", ctrl=True)
        yield from self.driver.drawn()

    # Looking closely

    def compare_with_display(self, name):
        """The overlay's pixels against Blender's own display of the same picture, saved as EXR."""
        driver, space = self.driver, self.driver.view.spaces.active
        switches = {
            (owner, name): getattr(owner, name)
            for owner, names in ((space.overlay, ["show_overlays"]), (space, SWITCHES))
            for name in names
        }
        yield from self._switch(dict.fromkeys(switches, False))
        yield from self._zoom_one_to_one()
        view_table = addon("viewport.view_table")
        yield from driver.until(lambda: view_table.is_complete(self.scene), "the table of the view transform", 300)
        yield from driver.drawn()
        photo = driver.photo(name)
        exr = driver.scratch / "shown.exr"
        write_exr(exr, self.picture())
        wanted = yield from in_image_editor(driver, exr, f"{name}-exr")
        shown, wanted = self._frame_on_screen(photo, np.round(wanted[::-1] * 255).astype(np.uint8))
        error = np.abs(shown.astype(int) - wanted.astype(int))
        mean, percentile = error.mean(), np.percentile(error, 99)
        driver.record(f"{name}: overlay against Blender's display, mean", mean, "1/255", 1)
        driver.record(f"{name}: overlay against Blender's display, 99th percentile", percentile, "1/255", 3)
        driver.check(mean <= 1 and percentile <= 3, f"the overlay is what Blender displays: {mean:.2f}, {percentile}")
        driver.check(wanted.std() > 5, "the picture shows something")
        yield from self._switch(switches)

    def _switch(self, switches):
        """Sets what the 3D view shows besides the picture. Blender crashes without the view's own context."""
        with self.driver.within():
            for (owner, name), value in switches.items():
                if getattr(owner, name) != value:
                    setattr(owner, name, value)
        yield from self.driver.drawn()

    def _frame(self):
        """The camera's frame, in pixels of the region."""
        region, data = self.driver.region(), self.driver.view.spaces.active.region_3d
        return addon("viewport.camera_frame").frame_of(self.scene, self.scene.camera, region, data)

    def _zoom_one_to_one(self):
        """A pixel of the picture is one of the screen; the frame grows with (sqrt 2 + zoom / 50)^2."""
        data, width = self.driver.view.spaces.active.region_3d, self.picture().shape[1]
        root = (2**0.5 + data.view_camera_zoom / 50) * (width / self._frame().width) ** 0.5
        data.view_camera_zoom = 50 * (root - 2**0.5)
        yield from self.driver.drawn()

    def _frame_on_screen(self, photo, wanted):
        """Part of the screen in the camera's frame, and the same part of the wanted picture; top row first."""
        region, frame = self.driver.region(), self._frame()
        height, width = wanted.shape[:2]
        left, bottom = round(frame.left), round(frame.bottom)
        self.driver.check(
            abs(frame.width - width) < 0.5 and abs(frame.height - height) < 0.5, f"the frame is 1 to 1: {frame}"
        )
        x = slice(max(left, 0), min(left + width, region.width))
        y = slice(max(bottom, 0), min(bottom + height, region.height))
        upwards = photo[::-1][region.y : region.y + region.height, region.x : region.x + region.width]
        shown = upwards[y, x]
        return shown[::-1], wanted[::-1][y.start - bottom : y.stop - bottom, x.start - left : x.stop - left][::-1]


def same(a, b):
    """True if pictures are the same but for rounding."""
    return a.shape == b.shape and np.abs(a - b).max() <= 1e-3 * max(a.max(), b.max())


def drag_and_undo(artist, light, pixels):
    """The picture follows a light that is dragged by the mouse, and goes back with undo."""
    driver, before, place = artist.driver, artist.picture(), tuple(artist.scene.objects[light].location)
    yield from artist.select(light)
    drawn = yield from artist.drag(pixels)
    driver.record("pictures drawn while dragging, 20 moves of 0.1 s", len(drawn), "pictures")
    driver.check(len(drawn) >= 2, f"the picture follows while a light is dragged; {len(drawn)} pictures")
    if artist.proxies():
        check_maker(artist, light, drawn)
    yield from artist.until_settled()
    driver.photo("dragged")
    driver.check(tuple(artist.scene.objects[light].location) != place, "the light was moved")
    driver.check(not same(artist.picture(), before), "the picture changed with the light")
    yield from artist.undo()
    yield from artist.until_settled()
    driver.check(tuple(artist.scene.objects[light].location) == place, "undo puts the light back")
    driver.check(same(artist.picture(), before), "undo puts the picture back")


def check_maker(artist, light, drawn):
    """Checks that pictures of a drag have the dragged light from its samples where the machine sums them in time, and
    else from its proxy: the last one is nearer to what that says than to what the other does."""
    driver = artist.driver
    moving = [(frame, request["lights"]) for frame, request in drawn if request["interactive"]]
    # The first may be of the place where it was, of which the sum is known.
    makers = {json.loads(frame.summary)["makers"][light] for frame, _ in moving[1:]}
    frame, lights = moving[-1]
    maker = "proxy" if json.loads(frame.summary)["makers"][light] == "proxy" else "samples"
    relighter = addon("engine.native").native().Relighter(artist.shot.folder)
    summed = relighter.relight(json.dumps(lights), maker="gather")
    alone = json.dumps([found for found in lights if found["name"] == light])
    learned = relighter.relight(alone, maker="proxy")["lights"][light]
    off = {}
    for name, part in (("samples", summed["lights"][light]), ("proxy", learned)):
        picture = (summed["combined"][..., :3] - summed["lights"][light] + part)[::-1]
        off[name] = np.abs(halved(picture, frame.scale) - frame.image[..., :3]).mean() / frame.image[..., :3].mean()
        driver.record(f"picture of a drag, off what the {name} says", 100 * off[name], "%")
    words = ", ".join(f"{100 * share:.2f} % off the {name}" for name, share in off.items())
    others = [share for name, share in off.items() if name != maker]
    driver.check(off[maker] < min(others), f"the picture of the drag is that of the {maker}: {words}; makers {makers}")


def halved(picture, scale):
    """A picture of even size by averages of `scale` by `scale` pixels."""
    height, width, channels = picture.shape
    return picture.reshape(height // scale, scale, width // scale, scale, channels).mean(axis=(1, 3))


def brighten(artist, light):
    """A row changes the picture and nothing in the scene."""
    driver, before = artist.driver, artist.picture()
    energy = artist.scene.objects[light].data.energy
    yield from artist.type_exposure(light, 0.5)
    seconds = yield from artist.set_exposure(light, 1.0)
    driver.record("overlay after a strength edit", seconds * 1000, "ms", 16)
    yield from artist.until_settled()
    after = artist.picture()
    driver.check(after.mean() > before.mean() and not same(after, before), "a stop more of a light is brighter")
    driver.check(artist.scene.objects[light].data.energy == energy, "rows write nothing to lights")
