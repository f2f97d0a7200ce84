"""Operators are shims: each does what its function does, in a scene of its own from the same beginning."""

import json
import re
import time
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
import relume
from solve_steps import LINE, solve

from addon.core import strokes as core
from addon.engine import devices
from addon.engine.cycles import reference as cycles_reference
from addon.engine.cycles import verify
from addon.engine.shot import background, shot, shot_list
from addon.engine.solve import solving
from addon.live import comparison as comparing
from addon.live.scheduler import scheduler
from addon.ui import background as background_ui
from addon.ui import looks, mixer, preferences
from addon.ui import start as starting
from addon.ui import verify as verifying
from addon.ui.shots import baking as shot_baking
from addon.ui.shots import operators as shot_operators
from addon.ui.solve import locks, operators, regions, results, scribble_tool, target
from addon.viewport import compare as pairs
from fake_live import FakeLive
from fake_solve import FakeJob, light
from helpers import add_light, add_quad, row, update

pytestmark = pytest.mark.oldest_and_newest

PLAIN = (bool, int, float, str)
KEPT = ("relume", "relume_mix", "relume_looks", "relume_solve", "relume_shots")
"""Properties of a scene."""
OF_THIS_SESSION = {"uid", "session", "thumbnail"}
"""Names that differ from run to run."""


class FakeWorker:
    """Stands in for another Blender: remembers what it was to do, and says nothing."""

    made = []

    def __init__(self, command, _folder):
        # The folder of the copy is another one each time.
        self.command = [re.sub(r".*/relume-[^/]*", "COPY", word) for word in command]
        self.ended, self.ending = False, ""
        FakeWorker.made.append(self)

    def events(self):
        """Stands in for `Worker.events`."""
        return []

    def stop(self):
        """Stands in for `Worker.stop`."""
        self.ending = "stopped"

    def kill(self):
        """Stands in for `Worker.kill`."""
        self.ending = "killed"

    def end(self, clean_up):
        """Stands in for `Worker.end`."""
        self.kill()
        clean_up()


class FakeLook:
    """Stands in for the search for graphics cards; there after a moment."""

    def __init__(self, _what):
        self.looks = 0

    @property
    def done(self):
        """Stands in for `Job.done`."""
        self.looks += 1
        return self.looks > 2

    def result(self):
        """Stands in for `Job.result`."""
        return {"devices": [{"name": "Card", "pci_bus_id": "1"}]}


@pytest.fixture
def others(monkeypatch, tmp_path):
    """Other programs: Blenders for the background and for Cycles, drivers of graphics cards, and xclip, which has a
    picture in X11's clipboard."""
    monkeypatch.setattr(background, "Worker", FakeWorker)
    monkeypatch.setattr(verify, "Worker", FakeWorker)
    monkeypatch.setattr(devices, "native", lambda: SimpleNamespace(start=FakeLook))
    program = tmp_path / "programs" / "xclip"
    program.parent.mkdir()
    program.write_text(f"#!/bin/sh\nexec /bin/cat '{tmp_path / 'target.png'}'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent))
    monkeypatch.setenv("DISPLAY", ":0")
    yield
    background.close_all()
    verify.close_all()


@pytest.fixture
def room(registered_for_all_files, others, monkeypatch, tmp_path):
    """Makes a lit scene with a picture, two looks, a stroke, two places and a target, always the same."""
    monkeypatch.setattr(relume, "solve", FakeJob)
    picture = tmp_path / "target.png"

    def make():
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        FakeLive.made.clear()
        FakeJob.made.clear()
        FakeWorker.made.clear()
        background.close_all()
        verify.close_all()
        preferences._messages.clear()
        monkeypatch.setattr(devices, "_names", [])
        scene = bpy.context.scene
        scene.render.resolution_x, scene.render.resolution_y = 160, 90
        scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
        scene.collection.objects.link(scene.camera)
        add_quad(scene)
        for name in ("Key", "Fill"):
            add_light(scene, "POINT", name)
        scene.relume.folder = str(tmp_path / "bake")
        update()
        starting.start(scene)
        FakeLive.made[-1].tell(samples=4, samples_total=8, state="cancelled")
        FakeLive.made[-1].show()
        scheduler.tick()
        looks.snapshot(scene, "One")
        row(scene, "Key").exposure = 1.0
        bpy.data.objects["Fill"].hide_render = True
        looks.snapshot(scene, "Two")
        row(scene, "Key").color = (1.0, 0.5, 0.2)
        regions.add_region(scene, "RECTANGLE")
        regions.add_region(scene, "MASK")
        meaning = core.meaning("brighter", 1.0, (1.0, 1.0, 1.0))
        scribble_tool.add_stroke(scene, core.Stroke(meaning, 0.1, 1.0, tuple(map(tuple, json.loads(LINE)))))
        image = bpy.data.images.new("Target", 16, 9)
        image.generated_color = (0.5, 0.4, 0.3, 1.0)
        image.filepath_raw, image.file_format = str(picture), "PNG"
        image.save()
        scene.relume_solve.target = image
        update()
        scheduler.tick()
        return scene

    yield make
    pairs.free()


def plain(group):
    """All that a group of properties holds."""
    found = {}
    for name in group.bl_rna.properties.keys():
        value = getattr(group, name)
        if name in OF_THIS_SESSION | {"rna_type"}:
            continue
        if isinstance(value, bpy.types.PropertyGroup):
            found[name] = plain(value)
        elif isinstance(value, bpy.types.ID) or value is None:
            found[name] = value and value.name
        elif isinstance(value, PLAIN):
            found[name] = value
        elif hasattr(value, "values"):
            found[name] = [plain(entry) for entry in value]
        else:
            found[name] = [float(number) for number in value] if not isinstance(value, set) else sorted(value)
    return found


def state(scene, folder):
    """All that operators write to, or ask the native module for."""
    pair = pairs.pair_of(scene)
    found = shot.of(scene)
    lights = {
        obj.name: (obj.data.energy, list(obj.data.color), obj.hide_render, obj.hide_get(), list(obj.location))
        for obj in scene.objects
        if obj.type == "LIGHT"
    }
    return deepcopy(
        {
            "scene": [plain(getattr(scene, name)) for name in KEPT],
            "view": plain(scene.relume_view),
            "lights": lights,
            "selected": sorted(obj.name for obj in scene.objects if obj.select_get()),
            "active": bpy.context.view_layer.objects.active and bpy.context.view_layer.objects.active.name,
            "pair": pair and (pair.labels, np.array(pair.a.image).tolist(), pair.b is None),
            "compares": comparing.running(scene) is not None,
            "solves": solving.running(scene) is not None,
            "asked": [(live.arguments, live.calls, live.requests[-1:], live.state) for live in FakeLive.made],
            "shot": found and (str(found.folder), found.camera, repr(found.status)),
            "images": sorted(image.name for image in bpy.data.images),
            "files": sorted(path.name for path in folder.rglob("*.json") if path.parent.name != "bake"),
            "said": preferences._messages,
            "devices": devices.names(),
            "target": target_pixels(scene),
            "workers": [(worker.command, worker.ending) for worker in FakeWorker.made],
            "background": [(job.name, job.wanted, job.options, job.error) for job in background.all_jobs()],
            "verified": verification(scene),
        }
    )


def target_pixels(scene):
    """Those of the target picture, which may lie in the .blend file."""
    image = scene.relume_solve.target
    return image and (image.packed_file is not None, list(image.pixels))


def verification(scene):
    """Job for Cycles, the picture to compare with, and the outcome."""
    found = verify.of(scene)
    if found is None:
        return None
    job = found._copy.folder / cycles_reference.JOB
    asked = json.loads(job.read_text()) if job.exists() else None
    return asked, found.ours.image.tolist(), found.is_running, found.error, found.result


def rest():
    """Until the picture after the last edit is asked for, which comes a moment later."""
    scheduler.tick()
    while scheduler.settling and shot.all_open():
        time.sleep(0.01)
        scheduler.tick()


def without_shot(scene):
    shot.of(scene).close()


def while_baking(scene):
    starting.start(scene)
    FakeLive.made[-1].tell(state="baking")
    scheduler.tick()


def with_pair(scene):
    target_frame = target.frame_of(np.zeros((4, 4, 3)))
    pairs.set_pair(scene, target_frame, None, "WIPE")


def while_solving(scene):
    regions.remove_region(scene)  # That without a mask.
    operators.begin(scene)


def solved(scene):
    regions.remove_region(scene)  # That without a mask.
    solve(scene, changed=[light("Key", energy=77.0)], added=[light("Relume 1")])


def shown_target(scene):
    for _ in target.show(scene):
        time.sleep(0.01)


def solve_to_the_end(scene, work):
    """Solves by what does it at once, with a solver and a picture that are there at once."""

    class Quick(FakeJob):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            self.answer(changed=[light("Key", energy=77.0)])

    live, relight = FakeLive.made[-1], FakeLive.made[-1].relight

    def relight_and_show(request):
        number = relight(request)
        live.show(serial=live.newest.serial + 1)
        return number

    regions.remove_region(scene)  # That without a mask.
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relume, "solve", Quick)
        patch.setattr(live, "relight", relight_and_show, raising=False)
        work(scene)


def baking_beside(scene):
    scene.relume.folder = str(Path(scene.relume.folder).with_name("beside"))
    background_ui.start(scene)


def with_present_picture(_scene):
    rest()
    FakeLive.made[-1].show(serial=FakeLive.made[-1].newest.serial + 1)
    scheduler.tick()


def while_verifying(scene):
    with_present_picture(scene)
    verifying.start(scene)


def verified(scene):
    while_verifying(scene)
    picture = verify.ImageFrame(np.ones((4, 4, 4), np.float32))
    found = verify.of(scene)
    found.reference, found.difference = picture, picture
    found.result = {"error": 0.1, "noise": 0.01, "psnr": 30.0, "clamped": 0.0}
    verifying.show(scene, "DIFFERENCE")


def ended(work):
    """Runs work to its end."""
    while next(work, rest) is not rest:
        time.sleep(0.01)


def as_one_rectangle(scene, **settings):
    regions.draw_rectangle(scene, (0.1, 0.2, 0.3, 0.4), **settings)


def painted(scene):
    meaning = core.meaning("warmer", 2.0, (1.0, 1.0, 1.0))
    scribble_tool.add_stroke(scene, core.Stroke(meaning, 0.05, 1.0, ((0.2, 0.5, 1.0), (0.8, 0.5, 1.0))))


def group(scene):
    """Both lights are in a collection."""
    rig = bpy.data.collections.new("Rig")
    scene.collection.children.link(rig)
    for name in ("Key", "Fill"):
        rig.objects.link(scene.objects[name])
    update()


def listed(scene):
    """Two cameras are in the list of shots."""
    camera = bpy.data.objects.new("Close", bpy.data.cameras.new("Close"))
    scene.collection.objects.link(camera)
    update()
    shot_operators.take(scene, shot_list.add_cameras(scene))


def bound(scene):
    """A marker has a camera."""
    scene.timeline_markers.new("Beat", frame=7).camera = scene.camera


def baking_all(scene):
    listed(scene)
    shot_baking.bake_all(scene)


def nothing(_scene):
    pass


RECTANGLE = {"rectangle": (0.1, 0.2, 0.3, 0.4), "goal": "darker"}
CASES = {
    "go_on": (nothing, lambda scene, _: starting.go_on(scene), {}),
    "rebake": (nothing, lambda scene, _: starting.start(scene, anew=True), {}),
    "show_bake": (without_shot, lambda scene, _: starting.show_bake(scene), {}),
    "find_bake": (
        without_shot,
        lambda scene, folder: starting.find_bake(scene, folder / "moved"),
        {"directory": "moved"},
    ),
    "pause": (nothing, lambda scene, _: starting.toggle_pause(scene), {}),
    "cancel": (while_baking, lambda scene, _: starting.cancel(scene), {}),
    "apply_to_lights": (nothing, lambda scene, _: mixer.apply_to_lights(scene), {}),
    "read_from_lights": (nothing, lambda scene, _: mixer.reset(scene), {}),
    "select_light": (nothing, lambda _scene, _: mixer.select_light(bpy.context, "Key"), {"light": "Key"}),
    "show_light": (nothing, lambda _scene, _: mixer.show_light(bpy.context, "Fill"), {"light": "Fill"}),
    "snapshot": (nothing, lambda scene, _: looks.snapshot(scene), {}),
    "restore_look": (nothing, lambda scene, _: looks.restore(scene, looks.active_look(scene).look()), {}),
    "restore_look with lights": (
        lambda scene: scene.relume_looks.__setattr__("active", 0),
        lambda scene, _: looks.restore(scene, looks.active_look(scene).look(), True),
        {"lights": True},
    ),
    "delete_look": (nothing, lambda scene, _: looks.delete(scene, scene.relume_looks.active), {}),
    "export_look": (
        nothing,
        lambda scene, folder: looks.export_file(looks.active_look(scene).look(), folder / "out.json"),
        {"filepath": "out.json"},
    ),
    "import_look": (
        nothing,
        lambda scene, folder: looks.import_file(scene, folder / "in.json"),
        {"filepath": "in.json"},
    ),
    "compare_looks": (nothing, lambda scene, _: comparing.start(scene, [looks.active_look(scene)]), {}),
    "stop_comparing": (with_pair, lambda scene, _: comparing.stop(scene), {}),
    "lock_group": (group, lambda scene, _: locks.toggle_group(scene, "Rig"), {"group": "Rig"}),
    "lock_all": (nothing, lambda scene, _: locks.toggle_all(scene, "position"), {"move": "position"}),
    "add_region": (nothing, lambda scene, _: regions.add_region(scene, "MASK"), {"kind": "MASK"}),
    "remove_region": (nothing, lambda scene, _: regions.remove_region(scene), {}),
    "draw_rectangle": (nothing, lambda scene, _: as_one_rectangle(scene, goal="darker"), RECTANGLE),
    "draw_rectangle of the target": (
        nothing,
        lambda scene, _: as_one_rectangle(scene, goal="darker", of_target=True),
        RECTANGLE | {"of_target": True},
    ),
    "scribble": (nothing, lambda scene, _: painted(scene), {"points": LINE, "goal": "warmer", "amount": 2.0}),
    "clear_strokes": (nothing, lambda scene, _: scribble_tool.clear_strokes(scene), {}),
    "load_target": (
        lambda scene: target.clear(scene),
        lambda scene, folder: target.load(scene, str(folder / "target.png")),
        {"filepath": "target.png"},
    ),
    "clear_target": (nothing, lambda scene, _: target.clear(scene), {}),
    "show_target": (nothing, lambda scene, _: shown_target(scene), {}),
    "apply_solved": (solved, lambda scene, _: results.apply(scene, looks.active_look(scene)), {}),
    "paste_target": (nothing, lambda _scene, _: ended(target.paste(bpy.context)), {}),
    "solve": (nothing, lambda scene, _: operators.begin(scene).run_to_end(), {}),
    "cancel_solve": (while_solving, lambda scene, _: solving.running(scene).cancel(), {}),
    "background_start": (nothing, lambda scene, _: background_ui.start(scene), {}),
    "background_cancel": (baking_beside, lambda _scene, _: background.all_jobs()[0].cancel(), {"number": 0}),
    "add_cameras": (nothing, lambda scene, _: shot_operators.take(scene, shot_list.add_cameras(scene)), {}),
    "add_from_markers": (bound, lambda scene, _: shot_operators.take(scene, shot_list.add_from_markers(scene)), {}),
    "add_view_layers": (nothing, lambda scene, _: shot_operators.take(scene, shot_list.add_view_layers(scene)), {}),
    "add_bake": (
        nothing,
        lambda scene, folder: shot_operators.take(scene, [shot_list.add_bake(scene, folder / "moved")]),
        {"directory": "moved"},
    ),
    "remove_shot": (listed, lambda scene, _: shot_operators.remove(scene), {}),
    "move_shot": (listed, lambda scene, _: shot_operators.move(scene, 1), {"direction": "DOWN"}),
    "bake_all": (listed, lambda scene, _: shot_baking.bake_all(scene), {}),
    "stop_baking": (baking_all, lambda scene, _: shot_baking.stop(scene), {}),
    "verify": (with_present_picture, lambda scene, _: verifying.start(scene), {}),
    "verify_cancel": (while_verifying, lambda scene, _: verify.close(scene.session_uid), {}),
    "verify_show": (verified, lambda scene, _: verifying.show(scene, "WIPE"), {"view": "WIPE"}),
    "verify_show live": (verified, lambda scene, _: verifying.show(scene, "LIVE"), {"view": "LIVE"}),
    "find_devices": (nothing, lambda _scene, _: ended(preferences.find_devices()), {}),
    "count_cache": (nothing, lambda _scene, _: preferences.begin(preferences.count_cache()), {}),
    "clean_cache": (nothing, lambda _scene, _: preferences.begin(preferences.clean_cache()), {}),
}
"""Preparation, function and own settings of each operator. Names of files are in the test's folder."""


def call(scene, work):
    work(scene)


AROUND = {"solve": solve_to_the_end}
"""Generators that must go on while a function does its work."""
OF_THE_WINDOW = {"lay_out", "look_through_camera", "pick_brush"}


def test_all_operators_are_compared(registered_for_all_files):
    """But for those that only a window has: what their mouse does is played there."""
    elsewhere = (  # test_start.py, test_mix.py, test_shot_baking.py, test_farm.py, test_usd_lights.py, ...
        "start reset_row unfold_warnings set_up_compositing contact_sheet save_sheet farm_write farm_collect "
        "export_lights import_lights only_this_shot copy_for_shot"
    )
    compared = {name.partition(" ")[0] for name in CASES} | set(elsewhere.split())
    assert set(dir(bpy.ops.relume)) - compared == OF_THE_WINDOW


@pytest.mark.parametrize("name", CASES)
def test_an_operator_does_what_its_function_does(room, tmp_path, name):
    prepare, function, settings = CASES[name]
    settings = {
        key: str(tmp_path / value) if key in {"filepath", "directory"} else value for key, value in settings.items()
    }
    manifest = '{"scene_hash": "", "passes": [], "tile_size": 64}'
    for folder in ("bake", "moved"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "manifest.json").write_text(manifest)
    looks_file = tmp_path / "in.json"

    def run(work):
        scene = room()
        if not looks_file.exists():
            looks.export_file(looks.active_look(scene).look(), looks_file)
        (tmp_path / "out.json").unlink(missing_ok=True)
        prepare(scene)
        rest()
        before = state(scene, tmp_path)
        AROUND.get(name, call)(scene, work)
        update()
        rest()
        return before, state(scene, tmp_path)

    def operate(_scene):
        assert getattr(bpy.ops.relume, name.partition(" ")[0])(**settings) == {"FINISHED"}

    before, by_function = run(lambda scene: function(scene, tmp_path))
    same_before, by_operator = run(operate)
    assert before == same_before, "both begin with the same"
    assert by_operator == by_function
    assert by_operator != before, "it does something"
