"""Relume as the render engine: shading Rendered equals the overlay and shows single passes, F12 leaves the picture,
disabling the add-on ends it. Verify and the background bake run in Blenders of their own. Reading a scene keeps the
last render."""

from functools import partial

import addon_utils
import bpy
import numpy as np
from artist import addon, settled
from display import read_exr
from driver import ADDON

NEEDS = ["demo.blend"]
EVERY_TIME = True


def has_pass(found, name):
    """True if there is a picture of a pass."""
    return found.picture_of(name) is not found.picture


def rendered(driver, seconds=300):
    """F12, to its end."""
    with bpy.context.temp_override(window=driver.window):
        bpy.ops.render.render("INVOKE_DEFAULT")
    yield from driver.wait(1.0)  # Blender starts the job a moment later.
    yield from driver.until(lambda: not bpy.app.is_job_running("RENDER"), "the end of F12", seconds)


def save_render(driver):
    """Saves Blender's render result; the path of the EXR."""
    path = driver.scratch / "f12.exr"
    bpy.data.images["Render Result"].save_render(str(path))
    return path


def render_without_bake(driver):
    """Renders with F12 where nothing is baked; the picture."""
    with driver.step("F12 without a bake"):
        yield from rendered(driver)
        first = read_exr(save_render(driver))
        driver.check(first.max() > 0.0, "there is light in the picture")
    return first


def check_start(driver, first):
    """Checks that Start keeps the last render, and shows the same picture."""
    scene = bpy.context.scene
    with driver.step("start keeps the last render"):
        yield from driver.show_tab("Relume")
        bpy.ops.relume.start()
        yield from settled(driver)
        driver.check((read_exr(save_render(driver)) == first).all(), "the last render is the user's")
        shown = addon("engine.shot.shot").of(scene).frame.image
        off = np.abs(shown - first).max() / first.max()
        driver.check(off <= 1e-3, f"the picture at rest is the one of F12, but for rounding: off by {off:.1e}")
        driver.check(scene.render.engine == "RELUME", "the engine is the user's")


def check_rendered(driver):
    """Checks the shading Rendered against the overlay; the camera's part of a photograph, and the photograph."""
    scene, view = bpy.context.scene, driver.view.spaces.active
    with driver.step("shading Rendered"):
        view.overlay.show_overlays = view.show_gizmo = False
        yield from driver.until(lambda: addon("viewport.view_table").is_complete(scene), "the view transform", 300)
        yield from driver.drawn()
        overlay = driver.photo("overlay").astype(float)
        scene.relume_view.shown, view.shading.type = False, "RENDERED"
        yield from driver.drawn()
        shading = driver.photo("rendered").astype(float)
        frame = addon("viewport.camera_frame").frame_of(scene, scene.camera, driver.region(), view.region_3d)
        left, top = driver.region().x + int(frame.left) + 4, overlay.shape[0] - driver.region().y - int(frame.top) + 4
        # Text in the side bar may change meanwhile.
        side_bar = next(region.x for region in driver.view.regions if region.type == "UI")
        part = slice(top, top + int(frame.height) - 8), slice(left, min(left + int(frame.width) - 8, side_bar))
        difference = np.abs(overlay[part] - shading[part])
        driver.check(np.ptp(overlay[part]) > 50, "there is a picture")
        driver.check(difference.mean() < 1.0, f"Rendered is the overlay's picture: {difference.mean():.2f} of 255")
    return part, shading


def check_passes(driver, part, shading):
    """Checks single passes in the shading Rendered, in a part of the window, against a photograph of the picture."""
    scene, view = bpy.context.scene, driver.view.spaces.active
    with driver.step("single passes in the shading Rendered"):
        found, whole = addon("engine.shot.shot").of(scene), addon("engine.shot.shot").of(scene).picture.image
        lights = addon("core.pass_names").light_passes(light["name"] for light in found.lights.descriptions)
        total = np.zeros_like(whole)
        for name in (*lights.values(), "world", "static"):
            view.shading.relume.render_pass = name
            yield from driver.until(partial(has_pass, found, name), f"the pass {name}", 60)
            yield from settled(driver)
            total += found.picture_of(name).image
        off = np.abs(total - whole)[..., :3].max() / whole.max()
        driver.check(off <= 1e-3, f"the passes add up to the picture: off by {off:.1e}")
        light, name = next(iter(lights.items()))
        view.shading.relume.render_pass = name
        yield from driver.until(partial(has_pass, found, name), f"the pass {name}", 60)
        yield from settled(driver)
        alone = driver.photo("pass")[part].astype(float)
        driver.check(np.abs(alone - shading[part]).mean() > 3.0, "it is not the whole picture")
        yield from driver.move_mouse(driver.region().x + 600, driver.region().y + 500)
        with driver.within("HEADER"):
            bpy.ops.wm.call_panel(name="VIEW3D_PT_shading", keep_open=True)
        yield from driver.drawn()
        driver.photo("popover")
        yield from driver.press("ESC")
        yield from driver.drawn()
        for name in addon("core.pass_names").AOVS:
            view.shading.relume.render_pass = name
            yield from driver.until(partial(has_pass, found, name), f"the pass {name}", 60)
            yield from settled(driver)
            surfaces = driver.photo(name.replace(" ", "-").lower())[part].astype(float)
            driver.check(np.abs(surfaces - shading[part]).mean() > 3.0, f"{name} is not the whole picture")
            driver.check(np.ptp(surfaces) > 50, f"there is something in {name}")
            is_grey = np.ptp(surfaces[100:-100, 100:-100], axis=-1).max() <= 2.0  # Tools and menus are around it.
            driver.check(is_grey == (name == "Depth"), "depth is grey, and nothing else is")
        driver.check(np.abs(found.picture.image - whole).max() <= 1e-3 * whole.max(), "the picture itself is the same")
        view.shading.relume.render_pass = "Combined"
        row = next(row for row in scene.relume_mix.rows if row.name == light)
        row.solo = True
        yield from settled(driver)
        difference = np.abs(driver.photo("solo")[part].astype(float) - alone).mean()
        driver.check(difference < 1.0, f"it is what S in the row of {light} shows: {difference:.2f} of 255")
        row.solo = False
        yield from settled(driver)
        scene.relume_view.shown, view.shading.type = True, "SOLID"


def verify(driver):
    """Verifies the picture, and shows the difference."""
    scene = bpy.context.scene
    with driver.step("verify"):
        scene.relume_verify.samples = 16
        bpy.ops.relume.verify()
        found = addon("engine.cycles.verify").of(scene)
        seconds = yield from driver.until(lambda: not found.is_running, "the render by Cycles", 300)
        driver.record("verify with 16 samples", seconds, "s")
        driver.check(found.result is not None and found.result["error"] < 1.0, f"it is verified: {found.error}")
        bpy.ops.relume.verify_show(view="DIFFERENCE")
        yield from driver.show_tab("Relume")
        yield from driver.drawn()
        driver.photo("difference")
        bpy.ops.relume.verify_show(view="LIVE")


def bake_in_background(driver):
    """Bakes a moved camera in the background."""
    scene = bpy.context.scene
    with driver.step("background"):
        scene.camera.location.x += 0.1
        bpy.ops.relume.background_start()
        job = addon("engine.shot.background").of(scene)
        yield from driver.until(lambda: not job.is_running, "the background bake", 300)
        driver.check(job.done, f"the background bake is ready: {job.error}")
        yield from settled(driver)
        driver.check(addon("engine.shot.shot").of(scene).folder == driver.scratch / "bake", "it is shown")


def disable_in_render(driver):
    """Disables the add-on while F12 bakes."""
    scene = bpy.context.scene
    with driver.step("disabled while F12 bakes"):
        scene.camera.location.x += 0.1
        scene.relume.samples = 100_000
        with bpy.context.temp_override(window=driver.window):
            bpy.ops.render.render("INVOKE_DEFAULT")
        yield from driver.wait(3.0)
        driver.check(bpy.app.is_job_running("RENDER"), "it bakes")
        addon_utils.disable(ADDON)
        seconds = yield from driver.until(lambda: not bpy.app.is_job_running("RENDER"), "the end of F12", 30)
        driver.record("F12 ends after disabling", seconds, "s")
        yield from driver.wait(1.0)
        driver.check(not hasattr(bpy.types.Scene, "relume_render"), "nothing is left")


def play(driver):
    """See the first lines of this file."""
    yield from driver.open("demo.blend")
    yield from driver.look_through_camera()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 320, 180, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.relume.quality, scene.relume.samples = "CUSTOM", 4
    scene.relume.folder = str(driver.scratch / "bake")
    addon("engine.shot.options").preferences().train_seconds = 0.0
    bpy.context.preferences.view.render_display_type = "NONE"
    scene.render.engine = "RELUME"
    first = yield from render_without_bake(driver)
    yield from check_start(driver, first)
    part, shading = yield from check_rendered(driver)
    yield from check_passes(driver, part, shading)
    yield from verify(driver)
    yield from bake_in_background(driver)
    yield from disable_in_render(driver)
