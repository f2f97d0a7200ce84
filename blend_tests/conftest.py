"""Tests that need Blender, as the `bpy` module. One process for one Blender version; an empty scene for each test."""

import os
import sys
from pathlib import Path

import bpy
import pytest

REPOSITORY = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(REPOSITORY))
bpy.ops.preferences.addon_enable(module="cycles")

_results = {"collected": 0, "reported": 0}


@pytest.fixture(autouse=True)
def scene():
    """An empty scene with Cycles and a camera 5 m above the origin that looks down."""
    # Without preferences, which take Blender five times as long; tests that change them put them back.
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.sample_clamp_indirect = 0.0
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (0.0, 0.0, 5.0)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


@pytest.fixture
def fake_native(monkeypatch):
    """A fake native module."""
    import relume

    from fake_live import FakeBoard, FakeLight, FakeLive, FakeRequest

    monkeypatch.setattr(relume, "Board", FakeBoard, raising=False)
    monkeypatch.setattr(relume, "Live", FakeLive)
    monkeypatch.setattr(relume, "Light", FakeLight)
    monkeypatch.setattr(relume, "Request", FakeRequest)
    FakeLive.made.clear()


@pytest.fixture
def registered(scene, fake_native):
    """The add-on, enabled, with a fake native module."""
    bpy.ops.preferences.addon_enable(module="addon")
    yield
    bpy.ops.preferences.addon_disable(module="addon")


@pytest.fixture
def registered_for_all_files(scene, fake_native):
    """The add-on without preferences: factory settings, which tests open as another file, do not disable it."""
    import addon

    addon.register()
    yield
    addon.unregister()


@pytest.fixture
def lit(scene, registered, tmp_path):
    """A lit plane with a folder to bake into."""
    from helpers import add_light, add_quad

    add_quad(scene)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    scene.relume.folder = str(tmp_path / "bake")
    return scene


@pytest.fixture
def views_here(monkeypatch):
    """No other Blender colours views."""
    from addon.engine.workers import view_worker
    from addon.viewport import view_table
    from views import ColouredHere

    here = ColouredHere()
    monkeypatch.setattr(view_worker, "shared", lambda: here)
    view_table.clear()
    yield here
    view_table.clear()


@pytest.fixture
def small_tables(views_here, monkeypatch):
    """Tables of a view that take a moment, for what does not depend on their entries."""
    from addon.export import color_table, view_file

    monkeypatch.setattr(color_table, "SIZE", 17)
    monkeypatch.setattr(view_file, "SIZE", 17)


@pytest.fixture
def rigged(scene, registered_for_all_files, tmp_path):
    """A key, a fill in a rig, and a folder to bake into."""
    from helpers import add_light, add_quad, update

    add_quad(scene)
    add_light(scene, "AREA", "Key", location=(1, 2, 3), shape="DISK", size=0.5)
    rig = bpy.data.collections.new("Rig")
    scene.collection.children.link(rig)
    fill = add_light(scene, "POINT", "Fill", shadow_soft_size=0.2)
    scene.collection.objects.unlink(fill)
    rig.objects.link(fill)
    scene.relume.folder = str(tmp_path / "bake")
    update()
    return scene


@pytest.fixture
def lit_by_two(scene, registered_for_all_files, monkeypatch, tmp_path):
    """A key and a fill on a plane, with a folder to bake into and a fake solver."""
    import relume

    from fake_solve import FakeJob
    from helpers import add_light, add_quad, update

    monkeypatch.setattr(relume, "solve", FakeJob)
    FakeJob.made.clear()
    add_quad(scene)
    add_light(scene, "AREA", "Key", location=(1, 2, 3), shape="DISK", size=0.5)
    add_light(scene, "POINT", "Fill", shadow_soft_size=0.2)
    scene.relume.folder = str(tmp_path / "bake")
    update()
    return scene


@pytest.fixture
def baked(lit_by_two):
    """With a picture."""
    from addon.live.scheduler import scheduler
    from addon.ui.start import start
    from fake_live import FakeLive

    start(lit_by_two)
    live = FakeLive.made[-1]
    live.tell(samples=4, state="ready")
    live.show()
    scheduler.tick()
    return lit_by_two


@pytest.fixture
def live(scene, registered_for_all_files, tmp_path):
    """Starts a shot of the scene as it is, with a plane; the fake native module."""
    from addon.ui.start import start
    from fake_live import FakeLive
    from helpers import add_quad, update

    def begin():
        scene.relume.folder = str(tmp_path / "bake")
        update()
        start(scene)
        return FakeLive.made[-1]

    add_quad(scene)
    return begin


@pytest.fixture
def painted(baked):
    """With a stroke."""
    from solve_steps import LINE

    assert bpy.ops.relume.scribble(points=LINE, goal="brighter", amount=1.0) == {"FINISHED"}
    return baked


@pytest.fixture
def studio(scene, tmp_path):
    """The add-on enabled with the real native module, a plane and a light, a folder, no time for training."""
    from addon.engine.shot import options
    from helpers import add_light, add_material, add_quad

    bpy.ops.preferences.addon_enable(module="addon")
    options.preferences().train_seconds = 0.0
    material, tree, output = add_material("White")
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
    add_quad(scene, size=4.0, material=material)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    scene.render.resolution_x, scene.render.resolution_y = 32, 24
    scene.relume.folder = str(tmp_path / "bake")
    scene.relume.quality, scene.relume.samples = "CUSTOM", 16
    bpy.context.view_layer.update()
    yield scene
    bpy.ops.preferences.addon_disable(module="addon")


@pytest.fixture(scope="session")
def scenes_folder():
    """Real scenes made by others; skips without them."""
    folder = Path(os.environ.get("RELUME_SCENES") or REPOSITORY.parent / "shared" / "scenes")
    if not (folder / "cornell_box.blend").exists():
        assert not (os.environ.get("CI") and folder.is_dir()), f"{folder} has no cornell_box.blend"
        pytest.skip(f"the real scenes are not in {folder}; set RELUME_SCENES")
    return folder


@pytest.fixture(scope="session")
def gpu_started():
    """Blender's own GPU context without a window; skips before Blender 5.2, which has none."""
    import gpu

    if not hasattr(gpu, "init"):
        pytest.skip("this Blender has a GPU context only with a window (gpu.init is new in 5.2)")
    gpu.init()


def pytest_report_header():
    """Which Blender this is."""
    return f"Blender {bpy.app.version_string}, Python {sys.version.split()[0]}"


def pytest_collection_finish(session):
    """Counts what should run: `-k` and `-m` have left out by now what should not."""
    _results["collected"] = len(session.items)


def pytest_runtest_logfinish():
    """Counts what ran."""
    _results["reported"] += 1


def pytest_sessionfinish(session, exitstatus):
    """Nothing collected, or a test that never ran, is a failure."""
    if _results["collected"] == 0 or (exitstatus == 0 and _results["reported"] != _results["collected"]):
        session.exitstatus = 3


def pytest_unconfigure(config):
    """Leaves without Blender's own exit, which can crash before 5.0 after all tests have passed."""
    session = getattr(config, "_relume_session", None)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(int(session.exitstatus) if session else 3)


def pytest_sessionstart(session):
    """Remembers the session for its exit status."""
    session.config._relume_session = session
