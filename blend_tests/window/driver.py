"""Plays a scenario in Blender's window, step by step, from a timer: Blender draws and works in between.

A scenario is a generator function `play(driver)`: it yields whenever Blender shall go on, and waits with
`yield from driver.until(...)`. What goes wrong is collected in `result.json`, which `judge.py` reads.
"""

import contextlib
import json
import math
import time
import traceback

import bpy
import gpu
from screen import photograph, write_png

ADDON = "bl_ext.user_default.relume"
INTERVAL = 0.01
NAP_SECONDS = 0.005
"""Sleep in each turn of an idle window. Blender sleeps so itself except where it may simulate events: there it would
keep a core busy with nothing."""
TYPED = dict(zip("0123456789.-", "ZERO ONE TWO THREE FOUR FIVE SIX SEVEN EIGHT NINE PERIOD MINUS".split(), strict=True))
"""Keys of signs."""
ROW_PIXELS = 14
"""Less than the height of a button."""
EDGE_PIXELS = 24
"""Above the lower edge of a region, where a click drags the edge instead."""
SEARCHES = 3
"""For a button, before it is not there."""


class Driver:
    """Means of a scenario to act and judge. Folders: `scenes` to read, `scratch` to write, `pictures` for photos."""

    def __init__(self, name, folder):
        self.name = name
        self.scenes, self.scratch, self.pictures = folder / "scenes", folder / "scratch", folder / "pictures"
        self._framebuffer = folder / "screen" / "Xvfb_screen0"
        self._file = folder / "result.json"
        self._result = {"finished": False, "step": "start", "checks": 0}
        self._result |= {name: [] for name in ("failures", "figures", "expected", "skipped")}
        self._mouse = (0, 0)
        self._found = {}
        """Where buttons were the last time: how far the side bar was scrolled, and the height in the window."""
        self._save()

    # Playing

    def start(self, play):
        """Plays from now on, then quits Blender."""
        steps = play(self)

        def tick():
            try:
                next(steps)
                return INTERVAL
            except StopIteration:
                self._result["finished"] = True
            except Exception:
                self.fail(f"{self._result['step']}: {traceback.format_exc()}")
                self.photo("failed")
            return self._quit()

        bpy.app.timers.register(tick, persistent=True)
        bpy.app.timers.register(self._nap, persistent=True)

    @staticmethod
    def _nap():
        """Called in every turn of Blender's window."""
        time.sleep(NAP_SECONDS)
        return 0.0

    @contextlib.contextmanager
    def step(self, name):
        """Names what is done, and notes how long it took."""
        self._result["step"] = name
        self._save()
        begun = time.perf_counter()
        yield
        self.record(f"{name}: all of it", time.perf_counter() - begun, "s")

    def _quit(self):
        try:
            self._result["errors"] = self.errors_shown()
        except Exception:
            self.fail(traceback.format_exc())
        finally:
            self._save()
            bpy.ops.wm.quit_blender()

    def _save(self):
        self._file.write_text(json.dumps(self._result, default=str))

    # Judging

    def check(self, truth, claim):
        """A claim that must hold; the scenario goes on either way."""
        self._result["checks"] += 1
        if not truth:
            self.fail(f"{self._result['step']}: not so: {claim}")

    def fail(self, text):
        """Something went wrong."""
        self._result["failures"].append(text)
        self._save()

    def expect_error(self, pattern):
        """An error that the scenario provokes, a regular expression found in a line of the log or in what is shown."""
        self._result["expected"].append(pattern)

    def skip(self, what):
        """Something that this machine does not allow: what and why. It is said beside the outcome."""
        self._result["skipped"].append(what)

    def record(self, name, value, unit, goal=None):
        """A figure for out/window.json."""
        figure = {"name": f"{self.name}: {name}", "value": round(float(value), 3), "unit": unit, "goal": goal}
        self._result["figures"].append(figure)

    # Waiting

    def wait(self, seconds):
        """Lets Blender go on for a while."""
        end = time.perf_counter() + seconds
        while time.perf_counter() < end:
            yield

    def until(self, condition, what, seconds=30):
        """Waits for a condition; fails with what was waited for (a text, or a function that gives it at the end).
        Returns the seconds that it took."""
        start = time.perf_counter()
        while not condition():
            if time.perf_counter() > start + seconds:
                raise TimeoutError(f"waited {seconds} s for: {what() if callable(what) else what}")
            yield
        return time.perf_counter() - start

    def drawn(self):
        """Waits until the whole window has been drawn again."""
        draws = []
        handler = bpy.types.SpaceView3D.draw_handler_add(lambda: draws.append(1), (), "WINDOW", "POST_PIXEL")
        try:
            for area in self.window.screen.areas:
                area.tag_redraw()
            yield from self.until(lambda: draws, "a redraw of the 3D view")
        finally:
            bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
        # The drawing of the view comes before the window is shown, and a card's picture reaches the screen later still.
        is_software = "llvmpipe" in gpu.platform.renderer_get()
        yield from self.wait((3 if is_software else 20) * INTERVAL)

    # Looking

    def photo(self, name=None):
        """Pixels of the screen, uint8 [height, width, 3], top row first; kept as a picture if it has a name."""
        pixels = photograph(self._framebuffer)
        if name:
            write_png(self.pictures / f"{self.name}-{name}.png", pixels)
        return pixels

    def errors_shown(self):
        """The messages of errors that Blender has shown since the start, as its Info editor lists them."""
        area = next(area for area in self.window.screen.areas if area != self.view)
        manager, before = bpy.context.window_manager, area.type
        area.type = "INFO"
        space = area.spaces.active
        for kind in ("debug", "info", "operator", "warning"):
            setattr(space, f"show_report_{kind}", False)
        manager.clipboard = " "  # An empty text would leave what is there.
        with bpy.context.temp_override(window=self.window, area=area, region=area.regions[-1]):
            bpy.ops.info.select_all(action="SELECT")
            bpy.ops.info.report_copy()
        area.type = before
        # Calls of operators by scripts are listed whatever the switches say.
        return [line for line in manager.clipboard.splitlines() if not line.startswith("bpy.")]

    # The window

    @property
    def window(self):
        """The first window."""
        return bpy.context.window_manager.windows[0]

    @property
    def view(self):
        """The largest 3D view of the first window, an area."""
        return self.view_of(self.window)

    def view_of(self, window):
        """The largest 3D view of a window."""
        views = [area for area in window.screen.areas if area.type == "VIEW_3D"]
        return max(views, key=lambda area: area.width * area.height)

    def region(self, kind="WINDOW", window=None):
        """A region of the 3D view of a window, by default the first one."""
        view = self.view_of(window or self.window)
        return next(region for region in view.regions if region.type == kind)

    def within(self, kind="WINDOW"):
        """A context for operators in a region of the 3D view."""
        return bpy.context.temp_override(window=self.window, area=self.view, region=self.region(kind))

    def open(self, name):
        """Opens a scene of the folder `scenes`."""
        bpy.ops.wm.open_mainfile(filepath=str(self.scenes / name))
        yield from self.drawn()

    def look_through_camera(self):
        """Camera view, the camera's frame as large as fits."""
        self.view.spaces.active.region_3d.view_perspective = "CAMERA"
        yield from self.drawn()
        with self.within():
            bpy.ops.view3d.view_center_camera()
        yield from self.drawn()

    def show_tab(self, name):
        """Opens the side bar of the 3D view on a tab, scrolled to its top."""
        self.view.spaces.active.show_region_ui = True
        yield from self.drawn()
        self.region("UI").active_panel_category = name
        yield from self.scroll_tab(-100_000)

    def scroll_tab(self, pixels):
        """Moves the content of the side bar up by pixels, as far as there is any; the pixels that it moved."""
        before = self._bottom_of_tab()
        with self.within("UI"):
            # Not `scroll_down`, which takes no distance by scripts: it goes on by one turn of the wheel.
            bpy.ops.view2d.pan(deltay=-pixels)
        yield from self.drawn()
        return before - self._bottom_of_tab()

    def _bottom_of_tab(self):
        """Place in the side bar's content that is at its lower edge: pixels, falling as it is scrolled down."""
        return self.region("UI").view2d.region_to_view(0, 0)[1]

    # The person's hands: Blender's own simulated events, which go the same way as those of a mouse

    def _event(self, kind, value, **more):
        x, y = self._mouse
        self.window.event_simulate(kind, value, x=x, y=y, **more)
        yield from self.wait(2 * INTERVAL)

    def move_mouse(self, x, y):
        """To a place in the window, pixels from its lower left corner."""
        self._mouse = (round(x), round(y))
        yield from self._event("MOUSEMOVE", "NOTHING")

    def press(self, kind, **modifiers):
        """Presses and releases a key or a button of the mouse: "LEFTMOUSE", "G", "ESC"; `ctrl=True` and so on."""
        letter = kind.lower() if len(kind) == 1 and not modifiers else ""
        yield from self._event(kind, "PRESS", unicode=letter, **modifiers)
        yield from self._event(kind, "RELEASE", **modifiers)

    def type(self, number):
        """Types a number, such as "1.5"."""
        for sign in number:
            kind = TYPED[sign]
            yield from self._event(kind, "PRESS", unicode=sign)
            yield from self._event(kind, "RELEASE")

    def click(self, x, y):
        """Clicks with the left button."""
        yield from self.move_mouse(x, y)
        yield from self.press("LEFTMOUSE")

    def drag(self, start, end, moves=10):
        """Moves the mouse from one place to another in small steps, as after `press("G")`."""
        for i in range(moves + 1):
            share = i / moves
            yield from self.move_mouse(*(a + share * (b - a) for a, b in zip(start, end, strict=True)))

    def sweep(self, places, button="LEFTMOUSE", **modifiers):
        """Holds a button of the mouse over places in the window, one after the other, and lets it go."""
        yield from self.move_mouse(*places[0])
        yield from self._event(button, "PRESS", **modifiers)
        for place in places[1:]:
            self._mouse = tuple(map(round, place))
            yield from self._event("MOUSEMOVE", "NOTHING", **modifiers)
        yield from self._event(button, "RELEASE", **modifiers)

    def find_button(self, what, across=0.3):
        """The place of a button in the side bar, by what it runs or sets: where it was the last time, or else the first
        below the mouse, or the first from the top down.

        `what`: part of its Python command, "relume.start", or of its data path, "relume_mix.rows[0].solo".
        `across`: where in the width of the side bar.
        """
        below = self._mouse[1]
        # Away from what the mouse is on now: Blender notices a move only when it comes to it.
        yield from self.move_mouse(0, 0)
        yield from self.wait(10 * INTERVAL)
        if button := self._found.get((what, across)):
            bottom, y = button
            yield from self.scroll_tab(round(self._bottom_of_tab() - bottom))
            if (yield from self._is_at(what, across, y)):
                return self._mouse
        seen = {}
        place = yield from self._search_shown(what, across, seen, below)
        # Drawing meanwhile may move a button to where the search has been.
        for _ in range(SEARCHES):
            place = place or (yield from self._search(what, across, seen))
        if not place:
            raise LookupError(f"no button for {what} in the side bar, but {list(seen)}")
        self._found[what, across] = self._bottom_of_tab(), place[1]
        return place

    def _search(self, what, across, seen):
        """`find_button`, once from the top of the side bar to its end; None if it is not found. Notes all buttons in
        `seen`."""
        yield from self.scroll_tab(-100_000)
        moved = height = self.region("UI").height
        while moved > 0:
            if place := (yield from self._search_shown(what, across, seen)):
                return place
            moved = yield from self.scroll_tab(height // 2)
        return None

    def _search_shown(self, what, across, seen, below=math.inf):
        """Place of a button in the shown part of the side bar, below a height in the window; None if there is none."""
        region = self.region("UI")
        for y in range(min(below, region.y + region.height) - ROW_PIXELS, region.y + EDGE_PIXELS, -ROW_PIXELS):
            yield from self.move_mouse(region.x + across * region.width, y)
            button = self._button_under_mouse()
            seen[button] = None
            # A window that draws slowly may still tell of the place before.
            for place in (y, y + ROW_PIXELS) if what in button else ():
                if (yield from self._is_at(what, across, place)):
                    return self._mouse
        return None

    def _is_at(self, what, across, y):
        """True if a button is at a height in the window; the mouse is over it then."""
        region = self.region("UI")
        yield from self.move_mouse(region.x + across * region.width, y)
        yield from self.wait(10 * INTERVAL)
        return what in self._button_under_mouse()

    def _button_under_mouse(self):
        """Python command or data path of the button in the side bar that the mouse is over."""
        manager = bpy.context.window_manager
        manager.clipboard = " "  # An empty text would leave what is there.
        with self.within("UI"):
            if bpy.ops.ui.copy_python_command_button.poll():
                bpy.ops.ui.copy_python_command_button()
            elif bpy.ops.ui.copy_data_path_button.poll():
                bpy.ops.ui.copy_data_path_button(full_path=True)
        return manager.clipboard

    def press_button(self, what, across=0.3):
        """Clicks a button in the side bar; see `find_button`."""
        place = yield from self.find_button(what, across)
        yield from self.click(*place)
