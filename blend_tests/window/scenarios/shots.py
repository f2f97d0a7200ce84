"""Three shots are listed, baked in another Blender, followed by clicks on the list, given other light in one of
them, and put on a contact sheet."""

import bpy
from artist import add_camera, addon

NEEDS = ["demo.blend"]
SCREEN = "1280x900"
BAKE_SECONDS = 600


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    yield from driver.look_through_camera()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 160, 90, 100
    scene.relume.quality, scene.relume.samples = "CUSTOM", 4
    scene.relume.folder = str(driver.scratch / "bakes")
    addon("engine.shot.options").preferences().train_seconds = 0.0
    add_camera(scene, "Left", -0.4, 0.1)
    add_camera(scene, "Right", 0.4, 0.3)
    yield from driver.show_tab("Relume")
    panel = addon("ui.shots.panel").RELUME_PT_shots
    # A second panel, open and above the others: Blender remembers that the own one was closed.
    opened = type("RELUME_PT_shots_open", (panel,), {"bl_idname": "RELUME_PT_shots_open", "bl_options": set()})
    opened.bl_order = -1
    bpy.utils.register_class(opened)

    with driver.step("list"):
        yield from driver.drawn()
        driver.photo("empty")
        yield from driver.press_button("relume.add_cameras")
        names = [entry.name for entry in scene.relume_shots.items]
        driver.check(len(names) == 3 and {"Left", "Right"} < set(names), f"three shots: {names}")
        yield from driver.drawn()
        driver.photo("list")

    with driver.step("bake"):
        yield from driver.press_button("relume.bake_all")
        batch = addon("engine.shot.background").batch_of(scene)
        yield from driver.until(lambda: batch.job is None or batch.job.stage["stage"] == "trace", "tracing", 300)
        yield from driver.drawn()
        driver.photo("baking")
        yield from driver.until(lambda: not batch.is_running, "all bakes", BAKE_SECONDS)
        driver.check(len(batch.baked) == 3 and not batch.failures, f"all are baked: {batch.failures}")

    with driver.step("follow"):
        pictures, shots = [], addon("engine.shot.shot")
        for number in range(3):
            scene.relume_shots.active = number
            yield from driver.until(lambda: shots.of(scene) is not None, "a shot", 30)
            found = shots.of(scene)
            yield from driver.until(lambda found=found: found.frame is not None and not found.is_busy, "a picture", 120)
            driver.check(scene.camera.name == found.camera, f"the view has the camera of shot {number}")
            yield from driver.drawn()
            pictures.append(driver.photo(f"shot-{number}").astype(float))
        changes = [abs(pictures[0] - other).mean() for other in pictures[1:]]
        driver.check(min(changes) > 0.5, f"each shot has a picture of its own: {changes}")

    with driver.step("own values"):
        bpy.utils.unregister_class(opened)
        rows = addon("live.rows")
        light = max((obj for obj in scene.objects if obj.type == "LIGHT"), key=lambda obj: obj.data.energy)
        scene.relume_mix.active = scene.relume_mix.rows.find(light.name)
        yield from driver.press_button("relume.only_this_shot")
        own = rows.own_values(rows.active_row(scene), rows.current_key(scene))
        driver.check(own is not None, "the row has values of its own")
        own.exposure = 2.0
        found = shots.of(scene)
        yield from driver.until(lambda: found.present_frame is not None and not found.is_busy, "brighter", 120)
        yield from driver.drawn()
        brighter = driver.photo("own-values").astype(float)
        driver.check(abs(brighter - pictures[2]).mean() > 0.5, "its picture is brighter")
        scene.relume_shots.active = 0
        found = shots.of(scene)
        yield from driver.until(lambda: found.present_frame is not None and not found.is_busy, "the first shot", 120)
        yield from driver.drawn()
        driver.photo("other-shot")
        gains = [rows.mix(scene, [light.name], entry.key)["gains"][light.name][0] for entry in scene.relume_shots.items]
        driver.check(gains == [1.0, 1.0, 4.0], f"the others have the common values: {gains}")

    with driver.step("sheet"):
        editor = max(driver.window.screen.areas, key=lambda area: (area.type != "VIEW_3D", area.width * area.height))
        editor.ui_type = "IMAGE_EDITOR"
        bpy.ops.relume.contact_sheet()
        sheet = addon("ui.shots.sheet")
        yield from driver.until(lambda: sheet.progress(scene) is None, "the sheet", 300)
        driver.check(not sheet.failure(scene), sheet.failure(scene))
        driver.check(editor.spaces.active.image.name == sheet.IMAGE, "the sheet is in the image editor")
        bpy.ops.relume.save_sheet(filepath=str(driver.pictures / "shots-the-sheet.png"))
        yield from driver.drawn()
        driver.photo("sheet")
