"""Looks come back as they were, in this file and in others."""

import json

import bpy
import pytest
from look_steps import dial, scene_state, values

from addon.core.looks import LookError, to_json
from addon.core.rows import Row
from addon.ui import looks, mixer
from helpers import add_light, row, update


def test_restoring_brings_rows_back_and_writes_nothing_to_lights(rigged):
    dial(rigged)
    kept = values(rigged)
    looks.snapshot(rigged)
    mixer.reset(rigged)
    bpy.data.objects["Key"].data.energy = 7.0
    before = scene_state(rigged)
    assert bpy.ops.relume.restore_look() == {"FINISHED"}
    assert values(rigged) == kept and scene_state(rigged) == before


def test_lights_that_a_look_does_not_know_are_switched_off_and_said(rigged):
    look = looks.snapshot(rigged).look()
    add_light(rigged, "POINT", "Rim")
    bpy.data.objects.remove(bpy.data.objects["Fill"])
    update()
    outcome = looks.restore(rigged, look)
    assert not row(rigged, "Rim").on and row(rigged, "Key").on
    assert str(outcome) == "not in this scene: Rig, Fill; not in the look, so switched off: Rim"


def test_looks_are_named_renamed_deleted_and_saved(rigged, tmp_path):
    for _ in range(3):
        assert bpy.ops.relume.snapshot() == {"FINISHED"}
    state = rigged.relume_looks
    assert [look.name for look in state.items] == ["Look", "Look.001", "Look.002"] and state.active == 2
    state.items[0].name = "Night"
    state.items[1].name = "Night"
    assert [look.name for look in state.items] == ["Night", "Night.001", "Look.002"]
    assert state.items[0].look().name == "Night"
    bpy.ops.relume.delete_look()
    assert state.active == 1 and len(state.items) == 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    reopened = bpy.context.scene.relume_looks
    assert [look.name for look in reopened.items] == ["Night", "Night.001"]


def test_a_file_serves_another_scene(rigged, tmp_path):
    dial(rigged)
    looks.snapshot(rigged, "Dusk")
    path = tmp_path / "dusk.json"
    assert bpy.ops.relume.export_look(filepath=str(path)) == {"FINISHED"}
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_light(scene, "SUN", "Key")
    update()
    assert bpy.ops.relume.import_look(filepath=str(path)) == {"FINISHED"}
    assert looks.active_look(scene).name == "Dusk"
    outcome = looks.restore(scene, looks.active_look(scene).look())
    assert row(scene, "Key").values() == Row(
        "Key", exposure=1.5, color=(1.0, 0.5, 0.25), use_kelvin=True, kelvin=3000.0
    )
    assert outcome.missing == ["Rig", "Fill"] and bpy.data.objects["Key"].data.type == "SUN"


@pytest.mark.parametrize(
    ("content", "says"),
    [(b"{", "not JSON"), (b'{"format": "relume-look", "version": 9}', "version 9"), (None, "No such file")],
)
def test_a_bad_file_is_one_clear_line_and_adds_nothing(rigged, tmp_path, content, says):
    path = tmp_path / "bad.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.relume.import_look(filepath=str(path))
    with pytest.raises((LookError, OSError)):
        looks.import_file(rigged, path)
    assert len(rigged.relume_looks.items) == 0


def test_a_file_of_a_stranger_is_refused(rigged, tmp_path):
    data = json.loads(to_json(looks.snapshot(rigged).look()))
    for found in data["rows"]:
        found["name"] = f"Other {found['name']}"
    path = tmp_path / "stranger.json"
    path.write_text(json.dumps(data))
    with pytest.raises(RuntimeError, match="none of this scene's lights"):
        bpy.ops.relume.import_look(filepath=str(path))


def test_a_failed_export_leaves_no_file(rigged, tmp_path):
    look = looks.snapshot(rigged).look()
    with pytest.raises(OSError):
        looks.export_file(look, tmp_path / "none" / "look.json")
    assert not (tmp_path / "none").exists()
