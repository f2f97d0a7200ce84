"""A scene read in a render: what is seen of it, and that nothing is left behind."""

import bpy
import numpy as np
import pytest

from addon.engine.reading.render_depsgraph import RelumeExportEngine, with_render_depsgraph
from addon.engine.reading.scene import load_scene, load_scene_async, scene_of_depsgraph
from addon.export import ExportError, ExportOptions
from addon.export.stop import ExportCancelled
from helpers import add_light, add_quad, render_cycles

pytestmark = pytest.mark.every_version


@pytest.fixture
def shot(scene):
    """A lit plane."""
    add_quad(scene, size=4.0)
    add_light(scene, "POINT", name="Key", shadow_soft_size=0.5)
    return scene


def saved_picture(tmp_path):
    """Pixels of what the user sees as the render result."""
    path = str(tmp_path / "result.exr")
    bpy.data.images["Render Result"].save_render(path)
    image = bpy.data.images.load(path)
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels


def test_the_users_pictures_stay_in_their_slots(shot, registered_for_all_files, tmp_path):
    render_cycles(shot, samples=4)
    slots = bpy.data.images["Render Result"].render_slots
    names = [slot.name for slot in slots]
    first = saved_picture(tmp_path)
    assert first.max() > 0.0
    slots.active_index = 1
    bpy.data.objects["Key"].data.energy *= 2.0
    render_cycles(shot, samples=4)
    second = saved_picture(tmp_path)
    for shown, picture in ((1, second), (0, first), (1, second)):
        slots.active_index = shown
        load_scene(shot)
        assert slots.active_index == shown and (saved_picture(tmp_path) == picture).all()
    assert [slot.name for slot in slots] == names and not (first == second).all()


def test_only_blenders_empty_picture_stays_where_nothing_was_rendered(shot):
    images, scenes = set(bpy.data.images.keys()), bpy.data.scenes.keys()
    for _ in range(2):
        load_scene(shot)
    assert set(bpy.data.images.keys()) == images | {"Render Result"}
    assert bpy.data.scenes.keys() == scenes and not RelumeExportEngine.is_registered


def settings_of(scene):
    """Settings in which the copy that is read differs from the scene."""
    render = scene.render
    return render.engine, render.use_sequencer, render.use_compositing, render.use_freestyle, render.use_single_layer


def test_the_scene_is_as_it_was_while_it_is_read(shot):
    before = settings_of(shot)
    assert with_render_depsgraph(shot, lambda _engine, depsgraph, _stop: settings_of(shot)) == before
    assert with_render_depsgraph(shot, lambda _engine, depsgraph, _stop: depsgraph.scene != shot)


def test_a_file_that_is_saved_meanwhile_has_no_copy_of_the_scene(shot, registered_for_all_files, tmp_path):
    path = str(tmp_path / "saved.blend")
    with_render_depsgraph(
        shot, lambda _engine, _depsgraph, _stop: bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    )
    with bpy.data.libraries.load(path) as (names, _wanted):
        assert names.scenes == [shot.name]


def test_undo_does_not_bring_the_copy_back(shot, registered_for_all_files):
    scenes = bpy.data.scenes.keys()
    bpy.ops.ed.undo_push(message="before")
    with_render_depsgraph(shot, lambda _engine, _depsgraph, _stop: bpy.ops.ed.undo_push(message="while it is read"))
    bpy.context.scene.render.resolution_x = 77
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.context.scene.render.resolution_x == 64
    assert bpy.data.scenes.keys() == scenes


@pytest.mark.parametrize("layer", ["ViewLayer", "Second"])
def test_the_first_layer_that_is_rendered_is_read(shot, layer):
    shot.view_layers.new("Second")
    shot.view_layers["ViewLayer"].use = layer == "ViewLayer"
    assert with_render_depsgraph(shot, lambda _engine, depsgraph, _stop: depsgraph.view_layer.name) == layer
    assert shot.view_layers["Second"].use


def test_later_without_a_window_is_at_once_and_the_same(shot):
    got = []
    assert load_scene_async(shot, None, lambda *outcome: got.append(outcome)) is None
    ((exported, error),) = got
    assert error is None and exported.summary() == load_scene(shot).summary()


def test_later_errors_come_by_the_callback(shot):
    got = []
    load_scene_async(shot, ExportOptions(camera="Nope"), lambda *outcome: got.append(outcome))
    ((exported, error),) = got
    assert exported is None and isinstance(error, ExportError) and "Nope" in str(error)


def test_an_export_can_be_stopped_between_two_parts(shot):
    answers = iter([False, False, True])

    def work(engine, depsgraph, _stop):
        return scene_of_depsgraph(engine, depsgraph, None, lambda: next(answers))

    with pytest.raises(ExportCancelled):
        with_render_depsgraph(shot, work)
    assert shot.render.engine == "CYCLES" and not RelumeExportEngine.is_registered


def test_the_engine_of_the_add_on_reads_and_renders(shot, registered):
    hashes = {load_scene(shot).hash}
    shot.render.engine = "RELUME"
    hashes.add(load_scene(shot).hash)
    assert len(hashes) == 1 and shot.render.engine == "RELUME" and not RelumeExportEngine.is_registered
