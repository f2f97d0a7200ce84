"""The pictures of the user guide: the way of an artist through the panels, on the demo scene."""

import bpy
from artist import WORK_SECONDS, addon
from driver import ADDON
from painter import Painter

NEEDS = ["demo.blend"]
SCREEN = "1920x1080"
BY_NAME = True


def shot():
    """The open shot of the scene."""
    return addon("engine.shot.shot").of(bpy.context.scene)


def settled(driver, what):
    """Waits for the final picture of what was asked for last."""
    found = shot()

    def done():
        shown = found.status["shown"]
        return not found.is_working and shown and shown["settled"] and not found.is_busy

    yield from driver.until(done, what, WORK_SECONDS)
    yield from driver.wait(0.5)
    yield from driver.drawn()


def press(driver, operator, **settings):
    """An operator of the panel."""
    with driver.within("UI"):
        driver.check(operator(**settings) == {"FINISHED"}, f"{operator.idname()} runs")
    yield from driver.drawn()


def show_preferences(driver):
    """The page of the extension, in the place of the 3D view."""
    area, preferences = driver.view, bpy.context.preferences
    area.ui_type = "PREFERENCES"
    preferences.active_section = "ADDONS"
    bpy.context.window_manager.addon_search = "Relume"
    bpy.ops.preferences.addon_expand(module=ADDON)
    area.tag_redraw()
    yield from driver.wait(1)
    driver.photo("preferences")
    area.ui_type = "VIEW_3D"


def show_popover(driver, panel, region, photo):
    """A photograph with a panel opened over the view."""
    view = driver.region()
    yield from driver.move_mouse(view.x + 0.5 * view.width, view.y + 0.75 * view.height)
    with driver.within(region):
        bpy.ops.wm.call_panel(name=panel, keep_open=True)
    yield from driver.wait(1)
    yield from driver.drawn()
    driver.photo(photo)
    yield from driver.press("ESC")
    yield from driver.drawn()


def limit(driver):
    """A light is locked, another may be moved too, and limits hold them all."""
    scene = bpy.context.scene
    settings, rows = scene.relume_solve, [row for row in scene.relume_mix.rows if row.kind == "LIGHT"]
    rows[0].locks.locked, rows[1].locks.position = True, True
    settings.limit_strength = settings.limit_tint = True
    scene.relume_mix.active = scene.relume_mix.rows.find(rows[1].name)
    yield from show_popover(driver, "RELUME_PT_solve_locks", "UI", "limits")
    rows[0].locks.locked, rows[1].locks.position = False, False
    settings.limit_strength = settings.limit_tint = False


def show_pass(driver):
    """A single light in the shading Rendered, and the menu that offers it."""
    scene, shading = bpy.context.scene, driver.view.spaces.active.shading
    before, scene.render.engine = scene.render.engine, "RELUME"
    scene.relume_view.shown, shading.type = False, "RENDERED"
    lights = (light["name"] for light in shot().lights.descriptions)
    shading.relume.render_pass = name = next(iter(addon("core.pass_names").light_passes(lights).values()))
    yield from driver.until(lambda: shot().picture_of(name) is not shot().picture, "the pass", 60)
    yield from settled(driver, "the picture as a whole")
    yield from show_popover(driver, "VIEW3D_PT_shading", "HEADER", "passes")
    shading.relume.render_pass, shading.type = "Combined", "SOLID"
    scene.render.engine, scene.relume_view.shown = before, True
    yield from settled(driver, "the overlay")


def solve(driver):
    """Strokes, the panel, and the result beside how it was before."""
    artist, settings = Painter(driver), bpy.context.scene.relume_solve
    with driver.within():
        bpy.ops.wm.tool_set_by_id(name="relume.scribble")
    driver.view.spaces.active.show_region_toolbar = True
    settings.size, settings.effort = 40, "QUICK"
    yield from driver.find_button("relume.pick_brush")
    yield from artist.paint("brighter", (0.2, 0.85), (0.6, 0.9))
    yield from artist.paint("warmer", (0.1, 0.2), (0.4, 0.2))
    yield from artist.paint("keep", (0.7, 0.3), (0.7, 0.6))
    yield from driver.wait(1)
    driver.photo("strokes")
    yield from artist.solve()
    yield from driver.wait(1)
    yield from driver.drawn()
    driver.photo("solved")
    yield from press(driver, bpy.ops.relume.stop_comparing)
    with driver.within():
        bpy.ops.wm.tool_set_by_id(name="builtin.select_box")
    yield from settled(driver, "the picture as it was")


def play(driver):
    """See the first line of this file."""
    relume = bpy.ops.relume
    bpy.context.preferences.addons[ADDON].preferences.train_seconds = 10
    with driver.step("open"):
        yield from driver.open("demo.blend")
        scene = bpy.context.scene
        scene.render.resolution_percentage = 100
        scene.relume.quality = "DRAFT"
        yield from driver.show_tab("Relume")
        yield from driver.look_through_camera()
        driver.photo("start")
    with driver.step("start"):
        yield from press(driver, relume.start)
        yield from driver.until(lambda: shot() and shot().frame, "the first picture", 60)
        yield from driver.until(lambda: addon("viewport.view_table").of(scene), "colours of the view", 60)
        yield from driver.wait(0.5)  # Panels slide to their places.
        yield from driver.drawn()
        driver.photo("first-picture")
        yield from settled(driver, "the end of the bake")
        driver.photo("ready")
    with driver.step("rows"):
        rows = [row for row in scene.relume_mix.rows if row.kind == "LIGHT"]
        driver.check(len(rows) == 3, f"a row for each of the three lights; {[row.name for row in rows]}")
        yield from press(driver, relume.snapshot)
        rows[0].use_kelvin, rows[0].kelvin, rows[1].exposure = True, 2800.0, 1.5
        yield from settled(driver, "the picture of the rows")
        driver.photo("rows")
    with driver.step("looks"):
        yield from press(driver, relume.snapshot)
        yield from driver.scroll_tab(400)
        driver.photo("looks")
        yield from driver.scroll_tab(-400)
    with driver.step("wipe"):
        scene.relume_view.wipe = True
        yield from driver.drawn()
        driver.photo("wipe")
        scene.relume_view.wipe = False
    with driver.step("limits"):
        yield from limit(driver)
    with driver.step("solve"):
        yield from solve(driver)
    with driver.step("passes"):
        yield from show_pass(driver)
    with driver.step("changes"):
        scene.camera.location.x += 0.02
        yield from driver.wait(1)
        yield from driver.drawn()
        driver.photo("changed")
        driver.check(bool(shot().changes.sentences), "a moved camera is noticed")
        scene.camera.location.x -= 0.02
    with driver.step("preferences"):
        yield from show_preferences(driver)
