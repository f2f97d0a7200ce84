"""A scene read in a render: what is seen of it, and that nothing is left behind."""

import bpy
import numpy as np
import pytest

from addon.engine.reading.engine_name import address_of_engine, set_engine_unseen
from addon.engine.reading.render_depsgraph import MARK, ExportCancelled, RelumeExportEngine, with_render_depsgraph
from addon.engine.reading.scene import load_scene, load_scene_async, scene_of_depsgraph
from addon.export import ExportError, ExportOptions
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


def test_the_users_render_stays(shot, tmp_path):
    render_cycles(shot, samples=4)
    before = saved_picture(tmp_path)
    assert before.max() > 0.0
    for _ in range(2):
        load_scene(shot)
        assert (saved_picture(tmp_path) == before).all()
    slots = bpy.data.images["Render Result"].render_slots
    assert slots.active_index == 0 and len([slot for slot in slots if slot.name == "Relume"]) == 1
    render_cycles(shot, samples=4)
    assert (saved_picture(tmp_path) == before).all()


def test_only_blenders_empty_picture_stays_where_nothing_was_rendered(shot):
    before = settings_of(shot)
    names = {image.name for image in bpy.data.images}
    for _ in range(2):
        load_scene(shot)
    assert {image.name for image in bpy.data.images} == names | {"Render Result"}
    assert bpy.data.images["Render Result"].render_slots.active_index == 0
    assert settings_of(shot) == before
    assert not RelumeExportEngine.is_registered


def settings_of(scene):
    """What is switched while a scene is read."""
    render = scene.render
    return render.engine, render.use_sequencer, render.use_compositing, render.use_freestyle


def test_a_file_that_is_saved_meanwhile_has_the_artists_settings(shot, registered_for_all_files, tmp_path):
    before = settings_of(shot)
    path = str(tmp_path / "saved.blend")

    def save(_depsgraph, _stop):
        bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
        return settings_of(bpy.context.scene), list(shot.keys())

    (engine, *_), _ = with_render_depsgraph(shot, save)
    assert engine == "RELUME" and settings_of(shot) == before
    with bpy.data.libraries.load(path) as (names, wanted):
        wanted.scenes = names.scenes
    assert settings_of(wanted.scenes[0]) == before and MARK not in wanted.scenes[0]


def test_undo_does_not_bring_the_hidden_engine_back(shot, registered_for_all_files):
    before = settings_of(shot)
    bpy.ops.ed.undo_push(message="before")
    with_render_depsgraph(shot, lambda _depsgraph, _stop: bpy.ops.ed.undo_push(message="while it is read"))
    bpy.context.scene.render.resolution_x = 77
    bpy.ops.ed.undo_push(message="after")
    bpy.ops.ed.undo()
    assert bpy.context.scene.render.resolution_x == 64
    assert settings_of(bpy.context.scene) == before and MARK not in bpy.context.scene


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

    def work(depsgraph, _stop):
        return scene_of_depsgraph(depsgraph, None, lambda: next(answers))

    with pytest.raises(ExportCancelled):
        with_render_depsgraph(shot, work)
    assert shot.render.engine == "CYCLES" and not RelumeExportEngine.is_registered


def test_the_engine_of_the_add_on_reads_and_renders(shot, registered):
    hashes = {load_scene(shot).hash}
    shot.render.engine = "RELUME"
    hashes.add(load_scene(shot).hash)
    assert len(hashes) == 1 and shot.render.engine == "RELUME" and not RelumeExportEngine.is_registered


def values_of(settings):
    """All numbers and words of a scene's render settings."""
    names = (prop.identifier for prop in settings.bl_rna.properties if prop.type not in {"POINTER", "COLLECTION"})
    return {name: repr(getattr(settings, name)) for name in names}


def test_an_engine_is_set_unseen_and_nothing_else(scene):
    scene.render.engine = "BLENDER_WORKBENCH"
    of_workbench = values_of(scene.render)
    scene.render.engine = "CYCLES"
    of_cycles = values_of(scene.render)
    for engine, values in 2 * (("BLENDER_WORKBENCH", of_workbench), ("CYCLES", of_cycles)):
        set_engine_unseen(address_of_engine(scene), engine)
        assert scene.render.engine == engine
        assert values_of(scene.render) == values


@pytest.mark.parametrize("name", ["CYCLES", "//pictures/CYCLES"])
def test_an_engine_whose_name_is_elsewhere_too_is_not_found(scene, name):
    scene.render.engine, scene.render.filepath = "CYCLES", name
    assert address_of_engine(scene) is None
    scene.render.filepath = "//pictures/"
    assert address_of_engine(scene) is not None
