"""Four shots are laid out in four views: all follow one dragged light, each becomes its own relight, one solve meets a
stroke in each and is seen in all of them, and the views are put together again. The list, a choice, the solve and what
is applied are undone and redone. Measures how much later the active picture is beside the others."""

import json
import time

import bpy
import numpy as np
import relume
from artist import add_camera, addon

NEEDS = ["demo.blend"]
SCREEN = "1280x900"
BAKE_SECONDS = 600
DRAG_SECONDS = 10.0


def drag(driver, lamp, found):
    """Moves a light in every tick; mean seconds from a request to its picture in the current shot."""
    asked, delays, start = {}, [], time.perf_counter()
    while time.perf_counter() < start + DRAG_SECONDS:
        lamp.location.x += 0.01 if len(asked) % 20 < 10 else -0.01
        yield
        now = time.perf_counter()
        asked.setdefault(found._request_number, now)
        if found.frame is not None and found.frame.request in asked:
            delays.append(now - asked.pop(found.frame.request))
    driver.check(len(delays) > 1, f"the active picture follows: {len(delays)} pictures")
    return float(np.mean(delays))


def go_back(driver, steps=1, forth=False):
    """Undoes or redoes steps, as Ctrl+Z in the view does."""
    with driver.within():
        for _ in range(steps):
            (bpy.ops.ed.redo if forth else bpy.ops.ed.undo)()
    yield from driver.drawn()


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    yield from driver.look_through_camera()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 320, 180, 100
    scene.relume.quality, scene.relume.samples = "CUSTOM", 8
    scene.relume.folder = str(driver.scratch / "bakes")
    addon("engine.shot.options").preferences().train_seconds = 0.0
    for name, right, up in (("Left", -0.4, 0.1), ("Right", 0.4, 0.3), ("High", 0.1, 0.5)):
        add_camera(scene, name, right, up)
    open_shots, live = addon("engine.shot.open_shots"), addon("live.scheduler").scheduler

    def listed():
        return [(entry.name, entry.camera.name) for entry in scene.relume_shots.items]

    with driver.step("list"):
        bpy.ops.ed.undo_push(message="Cameras")
        bpy.ops.relume.add_cameras("EXEC_DEFAULT", True)  # As its button, with a step of undo.
        added = listed()
        yield from go_back(driver)
        scene = bpy.context.scene
        driver.check(not listed(), f"undo takes the list away: {listed()}")
        yield from go_back(driver, forth=True)
        scene = bpy.context.scene
        driver.check(len(added) == 4 and listed() == added, f"redo brings it back: {listed()}")

    with driver.step("bake"):
        bpy.ops.relume.bake_all()
        batch = addon("engine.shot.background").batch_of(scene)
        yield from driver.until(lambda: not batch.is_running, "all bakes", BAKE_SECONDS)
        driver.check(len(batch.baked) == 4 and not batch.failures, f"all are baked: {batch.failures}")

    def shots():
        return open_shots.all_of(scene)

    def rest():
        return not live.settling and all(found.frame is not None and not found.is_busy for found in shots())

    lamp = max((obj for obj in scene.objects if obj.type == "LIGHT"), key=lambda obj: obj.data.energy)
    lamp_name = lamp.name
    with driver.step("alone"):
        scene.relume_shots.active = 0
        yield from driver.until(lambda: shots() and rest(), "the current picture", 200)
        alone = yield from drag(driver, lamp, open_shots.of(scene))
        yield from driver.until(rest, "rest", 200)

    with driver.step("choice"):
        bpy.ops.ed.undo_push(message="Drag")
        scene.relume_shots.active = 1
        bpy.ops.ed.undo_push(message="Choice")
        chosen = open_shots.of(scene).camera
        driver.check(chosen == scene.camera.name == listed()[1][1], f"the second shot is shown: {chosen}")
        yield from go_back(driver)
        scene, lamp = bpy.context.scene, bpy.context.scene.objects[lamp_name]
        first = listed()[0][1]
        yield from driver.until(lambda: shots() and open_shots.of(scene).camera == first, "the first shot again", 60)
        yield from driver.until(rest, "its picture", 200)
        driver.check(scene.camera.name == first, f"undo has the first camera again: {scene.camera.name}")

    with driver.step("lay out"):
        area, window = driver.view, driver.window

        def views():
            return [area for area in window.screen.areas if area.type == "VIEW_3D"]

        with bpy.context.temp_override(window=window, area=area):
            bpy.ops.relume.lay_out()
        yield from driver.until(lambda: len(views()) == 4 and all(view.width for view in views()), "four views")
        yield from driver.until(lambda: len(shots()) == 4 and rest(), "four pictures", 300)
        yield from driver.drawn()
        before = driver.photo("before").astype(float)

    with driver.step("mouse"):
        seen = addon("live.seen")
        # The view of the current shot is the last, for the drag.
        for view in sorted(views(), key=lambda view: view.spaces.active.camera == scene.camera):
            camera = view.spaces.active.camera
            yield from driver.move_mouse(view.x + view.width / 2, view.y + view.height / 2)
            yield from driver.until(
                lambda camera=camera: seen._attended is open_shots.showing(scene, camera), "the view under the mouse"
            )

    with driver.step("drag"):
        serials = {found.camera: found.serial for found in shots()}
        together = yield from drag(driver, lamp, seen._attended)
        yield from driver.drawn()
        driver.photo("dragged")
        yield from driver.until(rest, "rest", 300)
        followed = {found.camera: found.serial - serials[found.camera] for found in shots()}
        driver.check(min(followed.values()) > 1, f"all pictures follow: {followed}")
        driver.record("active picture alone", alone, "s")
        driver.record("active picture beside three", together, "s")
        driver.record("the active one is later by", 100.0 * (together / alone - 1.0), "%", 20.0)

    with driver.step("equal"):
        lamp.location.x += 0.3
        yield from driver.until(lambda: not rest(), "an edit", 30)
        yield from driver.until(rest, "rest", 300)
        for found in shots():
            lights = json.dumps({"format": "relume-lights", "version": 1, "lights": live.lights_of(scene, found)})
            expected = relume.Relighter(found.folder).relight(lights)["combined"]
            difference = float(np.abs(found.frame.image[::-1, :, :3] - expected).max())
            driver.check(difference < 1e-3, f"{found.camera} is its relight: {difference}")
        yield from driver.drawn()
        changed = np.abs(driver.photo("after").astype(float) - before).mean()
        driver.check(changed > 0.5, f"the views changed: {changed}")

    with driver.step("solve"):
        for entry in scene.relume_shots.items:
            points = json.dumps([[0.4, 0.5, 1.0], [0.6, 0.5, 1.0]])
            bpy.ops.relume.scribble(points=points, goal="brighter", amount=0.5, radius=0.2, shot=entry.key)
        scene.relume_solve.effort = "QUICK"
        bpy.ops.ed.undo_push(message="Strokes")
        with bpy.context.temp_override(window=window, area=views()[0]):
            bpy.ops.wm.tool_set_by_id(name="relume.scribble")
        yield from driver.drawn()
        driver.photo("strokes")
        with bpy.context.temp_override(window=window, area=views()[0]):
            bpy.ops.relume.solve("INVOKE_DEFAULT")
        solving = addon("engine.solve.solving")
        serials = {found.camera: found.serial for found in shots()}

        def followed():
            return solving.running(scene) is None or all(found.serial > serials[found.camera] for found in shots())

        yield from driver.until(followed, "previews in all views", 300)
        driver.photo("solving")
        driver.check(solving.running(scene) is not None, "all views follow the solve while it runs")
        yield from driver.until(lambda: solving.running(scene) is None, "the solve", 300)
        lines = [line["text"] for line in json.loads(scene.relume_solve.report)["lines"]]
        driver.check(len(lines) == len(shots()), f"a line for each stroke: {lines}")
        yield from driver.until(rest, "rest", 300)
        with bpy.context.temp_override(window=window, area=views()[0]):
            bpy.ops.wm.tool_set_by_id(name="builtin.select_box")

    def state():
        """State that undo has to bring back: the list, cameras of views, lights, strokes and looks."""
        lights = {light.name: (light.energy, *light.color) for light in bpy.data.lights}
        cameras = sorted(view.spaces.active.camera.name for view in views())
        looks, strokes = len(scene.relume_looks.items), scene.relume_solve.strokes
        return {"shots": listed(), "cameras": cameras, "lights": lights, "looks": looks, "strokes": strokes}

    def pictures():
        return {found.camera: np.array(found.frame.image) for found in shots()}

    def same(before, now):
        """True if all pictures are the same but for rounding."""
        pairs = [(before[name], now[name]) for name in before] if before.keys() == now.keys() else [(1.0, 0.0)]
        return all(np.abs(a - b).max() <= 1e-3 * np.max(a) for a, b in pairs)

    with driver.step("undo"):
        solved, pictures_solved = state(), pictures()
        bpy.ops.relume.apply_solved("EXEC_DEFAULT", True)
        yield from driver.until(rest, "rest", 300)
        yield from driver.drawn()
        driver.photo("applied")
        applied, pictures_applied = state(), pictures()
        driver.check(
            applied["lights"] != solved["lights"] and not applied["strokes"],
            "the lights are written, the strokes are done with",
        )
        driver.check(not same(pictures_solved, pictures_applied), "all views are brighter")
        for forth, wanted, shown in ((False, solved, pictures_solved), (True, applied, pictures_applied)):
            yield from go_back(driver, forth=forth)
            scene = bpy.context.scene
            yield from driver.until(rest, "rest", 300)
            driver.photo("redone" if forth else "undone")
            driver.check(state() == wanted, f"{'redo' if forth else 'undo'}: {state()} instead of {wanted}")
            driver.check(same(shown, pictures()), f"{'redo' if forth else 'undo'} brings all pictures back")
        yield from go_back(driver, 2)
        scene = bpy.context.scene
        yield from driver.until(rest, "rest", 300)
        wanted = solved | {"looks": 0}
        driver.check(state() == wanted, f"one step more takes the solve's looks away alone: {state()}")
        driver.check(same(pictures_solved, pictures()), "and leaves all pictures")

    with driver.step("together"):
        with bpy.context.temp_override(window=window, area=views()[0]):
            bpy.ops.relume.lay_out()
        yield from driver.until(lambda: len(views()) == 1, "one view")
        yield from driver.until(lambda: len(shots()) == 1, "the others to be closed", 30)
        yield from driver.drawn()
        driver.photo("together")
