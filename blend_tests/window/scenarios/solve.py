"""An artist paints what the picture should do; the lights solve themselves, are compared, applied and undone."""

import subprocess

import bpy
import numpy as np
from artist import addon
from display import write_exr
from painter import Painter
from screen import write_png

NEEDS = ["cornell_box.blend"]
FIRST = True
SIZE = (160, 160)


LIMITS_BELOW_SOLVE = 63
"""Pixels from the button *Solve* down to the closed panel *Constraints*."""
LOCK_ACROSS = 0.79
"""Where the locks of rows are in the width of the side bar."""
FAR = 0.4
"""Metres that the light of the target is away."""


def press_locks(driver, artist):
    """Locks are in the rows, those of parameters where a row is chosen; all are worked by hand."""
    row = next(row for row in artist.scene.relume_mix.rows if row.present and row.kind == addon("core.rows").LIGHT)
    driver.photo("rows")
    yield from driver.press_button("locks.locked", LOCK_ACROSS)
    yield from driver.drawn()
    driver.check(row.locks.locked, f"{row.name} is locked")
    driver.photo("locked")
    yield from driver.press_button("locks.locked", LOCK_ACROSS)
    driver.check(not row.locks.locked, f"{row.name} may change again")
    yield from driver.press_button("locks.position", 0.2)
    yield from driver.drawn()
    driver.check(row.locks.position, f"the place of {row.name} may change")
    driver.photo("locks")
    yield from driver.press_button("locks.position", 0.2)
    driver.check(not row.locks.position, f"the place of {row.name} is locked again")


def press_limits(driver, artist):
    """The panel that is closed at first says how far lights may go, and is worked by hand."""
    x, y = yield from driver.find_button("relume.solve")
    yield from driver.click(x, y - LIMITS_BELOW_SOLVE)
    yield from driver.wait(0.5)
    limits = {"limit_strength": "darker", "limit_tint": "tint", "limit_cone": "cone_least"}
    for switch, number in limits.items():
        yield from driver.press_button(f"relume_solve.{switch}")
        yield from driver.drawn()
        driver.check(getattr(artist.settings, switch), f"{switch} is on")
        yield from driver.find_button(f"relume_solve.{number}")
        driver.photo(switch)
        yield from driver.press_button(f"relume_solve.{switch}")
        yield from driver.drawn()
        driver.check(not getattr(artist.settings, switch), f"{switch} is off")
    x, y = yield from driver.find_button("relume.solve")
    yield from driver.click(x, y - LIMITS_BELOW_SOLVE)
    yield from driver.drawn()


def scribble(driver, artist):
    """Every way to use the brush."""
    with driver.within():
        bpy.ops.wm.tool_set_by_id(name="relume.scribble")
    driver.view.spaces.active.show_region_toolbar = True
    yield from driver.drawn()
    driver.check(artist.tool == "relume.scribble", f"the brush is in hand: {artist.tool}")
    artist.settings.stops = 1.0
    yield from artist.paint("brighter", (0.15, 0.85), (0.85, 0.85))
    driver.check([it.meaning.goal for it in artist.strokes] == ["brighter"], f"a stroke is kept: {artist.strokes}")
    points = artist.strokes[0].points
    driver.check(np.allclose(points[0][:2], (0.15, 0.85), atol=0.01), f"it begins where it was painted: {points[0]}")
    yield from artist.paint("keep", (0.3, 0.15), (0.7, 0.3), alt=True)
    driver.check(len(artist.strokes[1].points) == 2, "Alt draws straight")
    yield from artist.paint("keep", (0.3, 0.15), (0.4, 0.2), button="RIGHTMOUSE")
    driver.check(artist.strokes[-1].meaning.goal == "erase", "the right button erases")
    driver.photo("strokes")
    yield from artist.undo()
    driver.check([it.meaning.goal for it in artist.strokes] == ["brighter", "keep"], "undo takes back one stroke")
    yield from artist.paint("warmer", (0.1, 0.3), (0.3, 0.6), ctrl=True)
    driver.check(len(artist.settings.regions) == 1, "Ctrl draws a rectangle")
    driver.photo("rectangle")
    yield from artist.undo()
    driver.check(len(artist.settings.regions) == 0, "undo takes it back")
    before = artist.settings.size
    yield from driver.move_mouse(*artist.at(0.5, 0.5))
    yield from driver.press("F")
    x, y = artist.at(0.5, 0.5)
    yield from driver.move_mouse(x + 60, y)
    driver.photo("size")
    yield from driver.press("LEFTMOUSE")
    driver.check(artist.settings.size != before, f"F sets the size: {artist.settings.size}")
    artist.settings.size = before
    yield from driver.move_mouse(x, y)
    yield from driver.press("F", shift=True)
    yield from driver.move_mouse(x - 40, y)
    driver.photo("strength")
    yield from driver.press("LEFTMOUSE")
    strength = artist.settings.strength
    driver.check(strength < 1.0, f"Shift F sets the strength: {strength:.2f}")
    driver.check(artist.settings.size == before, "and leaves the size")
    artist.settings.strength = 1.0


def outside_the_camera(driver, artist):
    """Nothing is painted where it would mean nothing."""
    driver.expect_error("Look through the camera to paint")
    count = len(artist.strokes)
    data = driver.view.spaces.active.region_3d
    data.view_perspective = "PERSP"
    yield from driver.drawn()
    region = driver.region()
    x, y = region.x + region.width / 2, region.y + region.height / 2
    yield from driver.sweep([(x, y), (x + 50, y)])
    driver.check(len(artist.strokes) == count, "no stroke outside of the camera's view")
    driver.photo("no-camera")
    yield from driver.look_through_camera()


def look_at_target(driver, artist):
    """Reads the target and shows it beside the picture."""
    target = addon("engine.solve.target_image")
    yield from driver.until(lambda: target.reading_of(artist.scene).is_done, "the target is read", 60)
    yield from driver.drawn()
    return target.reading_of(artist.scene)


def large_targets(driver, artist):
    """Pictures of as many pixels as 3840 x 2160, in a file or painted in Blender, are read while the window goes on."""
    file, small = driver.scratch / "painting.png", driver.scratch / "small.png"
    pixels = np.random.default_rng(1).integers(1, 255, (360, 360, 3), np.uint8)
    write_png(file, pixels.repeat(8, axis=0).repeat(8, axis=1))
    write_png(small, pixels)
    bpy.data.images.load(str(small))  # Blender itself needs 0.1 s for the first file that it sees.
    painted = bpy.data.images.new("Painted", 2880, 2880)
    painted.pixels.foreach_set(np.full(2880 * 2880 * 4, 0.5, np.float32))
    yield from driver.wait(0.2)
    with driver.step("large target from a file"):
        with driver.within("UI"):
            bpy.ops.relume.load_target(filepath=str(file))
        found = yield from look_at_target(driver, artist)
        driver.check(found.found and "as this scene displays it" in found.found.words, f"it is read: {found.error}")
        driver.check(not artist.settings.target.has_data, "this Blender has not opened it")
    with driver.step("compare with a large target"):
        with driver.within("UI"):
            bpy.ops.relume.show_target()
        yield from driver.until(lambda: addon("viewport.compare").pair_of(artist.scene), "the comparison")
        yield from driver.drawn()
        driver.photo("target")
        with driver.within("UI"):
            bpy.ops.relume.stop_comparing()
    with driver.step("large target painted in Blender"):
        artist.settings.target = painted
        found = yield from look_at_target(driver, artist)
        driver.check(found.found is not None, f"it is read: {found.error}")
    artist.settings.target = None


def paste_nothing(driver):
    """No picture is said, and Blender's areas stay what they are."""
    kinds = [area.type for area in driver.window.screen.areas]
    driver.expect_error("The clipboard holds no picture")
    with driver.within("UI"):
        try:
            bpy.ops.relume.paste_target()
            driver.fail("pasting nothing is refused")
        except RuntimeError as error:
            driver.check("clipboard holds no picture" in str(error), f"in clear words: {error}")
    yield from driver.drawn()
    driver.check([area.type for area in driver.window.screen.areas] == kinds, "the areas are what they were")


def paste_picture(driver, artist):
    """One that another program has put into X11's clipboard."""
    file = driver.scratch / "copied.png"
    pixels = np.random.default_rng(2).integers(1, 255, (*SIZE[::-1], 3), np.uint8)
    write_png(file, pixels)
    command = ("xclip", "-selection", "clipboard", "-target", "image/png", "-in", str(file))
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    with driver.within("UI"):
        bpy.ops.relume.paste_target("INVOKE_DEFAULT")  # As its button does, which is in a panel that is closed.
    yield from driver.until(lambda: artist.settings.target, "the picture of the clipboard")
    found = yield from look_at_target(driver, artist)
    driver.check(found.found is not None, f"it is read: {found.error}")
    image = artist.settings.target
    copied = np.array(image.pixels[:]).reshape(*SIZE[::-1], 4)[::-1, :, :3]
    driver.check(np.array_equal(np.rint(255 * copied), pixels), "it is the picture that was copied")
    artist.settings.target = None


def check_strokes(driver, artist, strokes, before):
    """Checks that the picture in the view meets strokes where they were painted."""
    layers = addon("core.coverage").layers(strokes, SIZE)
    gains = {meaning.goal: artist.gain_since(before, layer) for meaning, layer in layers.items()}
    stops, kept = float(np.log2(gains["brighter"])), abs(gains["keep"] - 1.0)
    driver.record("asked for one stop, reached in the picture", stops, "stops")
    driver.record("asked to be kept, changed in the picture", 100 * kept, "%")
    driver.check(abs(stops - 1.0) < 0.15, f"where it was to be a stop brighter, it is: {stops:.2f} stops")
    driver.check(kept < 0.02, f"what was to be kept is: changed by {100 * kept:.1f} %")


def solve_target(driver, artist):
    """A light that was moved is brought to where a picture shows it."""
    light, file = artist.scene.objects["light_0"], driver.scratch / "target.exr"
    place = light.location.copy()
    light.location.x += FAR
    yield from artist.until_shown()
    wanted = artist.picture()
    write_exr(file, wanted)
    light.location = place
    yield from artist.until_shown()
    far = artist.error(wanted)
    settings, locks = artist.settings, artist.row("light_0").locks
    settings.add_count, settings.keep_rest, locks.position = 0, 0.0, True
    locks.color = locks.strength = False
    with driver.within("UI"):
        bpy.ops.relume.clear_strokes()
        bpy.ops.relume.load_target(filepath=str(file))
    found = yield from look_at_target(driver, artist)
    driver.check(found.found is not None, f"it is read: {found.error}")
    yield from artist.solve()
    yield from driver.press_button("relume.apply_solved")
    yield from artist.until_shown()
    driver.photo("target-solved")
    near, left = artist.error(wanted), abs(light.location.x - place.x - FAR)
    driver.record("difference from the target, of what it was", 100 * near / far, "%")
    driver.record("way to the target's light that is left", 100 * left / FAR, "%")
    driver.check(near < 0.15 * far, f"the picture is nearer to the target: {near:.4f}, before {far:.4f}")
    driver.check(left < 0.15 * FAR, f"the light is where the target has it: {left:.2f} m away in x")


def play(driver):
    """See the first line of this file."""
    artist = Painter(driver)
    with driver.step("open"):
        yield from artist.open("cornell_box.blend", SIZE, samples=16, train_seconds=0)
    with driver.step("start"):
        yield from artist.start()
        yield from artist.until_settled()
    with driver.step("locks"):
        yield from press_locks(driver, artist)
    with driver.step("limits"):
        yield from press_limits(driver, artist)
    with driver.step("scribble"):
        yield from scribble(driver, artist)
    with driver.step("outside"):
        yield from outside_the_camera(driver, artist)
    with driver.step("paste"):
        yield from paste_nothing(driver)
        yield from paste_picture(driver, artist)
    yield from large_targets(driver, artist)
    lights, before = artist.values(), artist.picture()
    with driver.step("cancel"):
        # Enough to do that it is not done before it is cancelled.
        artist.settings.effort, artist.settings.add_count = "THOROUGH", 4
        yield from driver.move_mouse(*artist.at(0.5, 0.5))
        yield from driver.press("RET")
        yield from driver.wait(1)
        driver.check(addon("engine.solve.solving").running(artist.scene) is not None, "it solves")
        driver.photo("solving")
        yield from driver.press("ESC")
        yield from driver.wait(0.5)
        driver.check(addon("engine.solve.solving").running(artist.scene) is None, "Esc cancels")
        driver.check(artist.tool == "relume.scribble", "and the brush stays in hand")
        driver.check(len(artist.scene.relume_looks.items) == 0 and artist.values() == lights, "nothing is left of it")
        yield from artist.until_settled()
    with driver.step("solve"):
        artist.settings.effort = "QUICK"
        artist.settings.add_count = 1  # The one that there is cannot keep the ceiling and light the floor.
        yield from artist.solve()
        names = [look.name for look in artist.scene.relume_looks.items]
        driver.check(names == ["Before", "Solve 1"], f"the result is a look: {names}")
        driver.check(artist.values() == lights, "the lights are as they were")
        yield from driver.wait(1)
        yield from driver.drawn()
        driver.photo("solved")
    with driver.step("compare"):
        for mode in ("A", "B", "DIFFERENCE", "WIPE"):
            artist.scene.relume_view.compare = mode
            yield from driver.drawn()
            driver.photo(f"compare-{mode.lower()}")
    with driver.step("apply"):
        strokes = artist.strokes
        yield from driver.press_button("relume.apply_solved")
        yield from artist.until_shown()
        driver.photo("applied")
        driver.check(artist.values() != lights, "the lights are what was solved")
        driver.check("Relume" in bpy.data.collections, "the new light has a collection of its own")
        driver.check(not artist.strokes, "strokes are done with")
        check_strokes(driver, artist, strokes, before)
    with driver.step("undo"):
        yield from artist.undo()
        yield from artist.until_settled()
        driver.check(artist.values() == lights, "one undo puts the lights back")
        driver.check(len(artist.strokes) == 2, "and the strokes")
        driver.check([it.name for it in artist.scene.relume_looks.items] == ["Before", "Solve 1"], "the looks stay")
    with driver.step("target"):
        yield from solve_target(driver, artist)
    with driver.step("leave"):
        yield from driver.move_mouse(*artist.at(0.5, 0.5))
        yield from driver.press("ESC")
        yield from driver.drawn()
        driver.check(artist.tool == "builtin.select_box", f"Esc leaves the brush: {artist.tool}")
        driver.photo("left")
