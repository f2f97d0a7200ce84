"""The rows of a scene follow its lights by themselves, keep their values and ask for pictures."""

import bpy
import pytest

import addon
from addon.core import rows as core
from addon.core.rows import GROUP, LIGHT, STATIC, WORLD
from addon.live import handlers, rows
from addon.ui import mixer
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_light, add_quad, row, update

NEUTRAL, SILENT = [1.0] * 3, [0.0] * 3


pytestmark = pytest.mark.usefixtures("registered_for_all_files")


def listed(scene):
    """Kind, name and depth of the rows, as the panel lists them."""
    found = sorted(rows.present_rows(scene), key=lambda row: row.order)
    return [(row.kind, row.name, row.depth) for row in found]


def shown(scene, grouped=True):
    """Names of the rows that the list shows."""
    items = scene.relume_mix.rows
    there = mixer.shown_rows(items, [item.order for item in items], grouped=grouped)
    return {item.name for item, is_shown in zip(items, there, strict=True) if is_shown}


def collection(scene, name, parent=None):
    """A linked collection."""
    made = bpy.data.collections.new(name)
    (parent or scene.collection).children.link(made)
    return made


def light_in(made, name, **settings):
    """A light in a collection."""
    obj = add_light(bpy.context.scene, "POINT", name, **settings)
    bpy.context.scene.collection.objects.unlink(obj)
    made.objects.link(obj)
    return obj


REST = [(STATIC, "Emissive Materials", 0)]


def test_rows_appear_without_set_up(scene):
    update()
    assert listed(scene) == REST
    add_light(scene, "POINT", "Key")
    add_light(scene, "AREA", "Fill")
    add_light(scene, "AREA", "Portal").data.cycles.is_portal = True
    scene.world = bpy.data.worlds.new("Sky")
    update()
    assert listed(scene) == [(LIGHT, "Fill", 0), (LIGHT, "Key", 0), (WORLD, "World", 0), *REST]


def test_collections_with_lights_are_groups(scene):
    outer = collection(scene, "Outer")
    inner = collection(scene, "Inner", outer)
    collection(scene, "Only meshes").objects.link(bpy.data.objects.new("Mesh", None))
    lamp = light_in(inner, "Lamp")
    outer.objects.link(lamp)
    light_in(outer, "Other")
    add_light(scene, "POINT", "Loose")
    update()
    groups = [(GROUP, "Outer", 0), (GROUP, "Inner", 1)]
    # Inner has one light: as long as it changes nothing it has no line.
    assert listed(scene) == [*groups, (LIGHT, "Lamp", 1), (LIGHT, "Other", 1), (LIGHT, "Loose", 0), *REST]
    assert shown(scene) == {"Outer", "Lamp", "Other", "Loose", "Emissive Materials"}
    assert shown(scene, grouped=False) == {"Lamp", "Other", "Loose", "Emissive Materials"}
    row(scene, "Outer", GROUP).multiplier = 2.0
    row(scene, "Inner", GROUP).exposure = 1.0
    assert {"Outer", "Inner"} <= shown(scene, grouped=False), "what changes something is always listed"
    found = rows.mix(scene, ["Lamp", "Other", "Loose"])["gains"]
    assert found == {"Lamp": [4.0] * 3, "Other": [2.0] * 3, "Loose": NEUTRAL}


def test_instanced_collections_are_groups_and_their_lights_follow(scene):
    library = bpy.data.collections.new("Library")
    library.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    for index in range(2):
        empty = add(scene, f"Lamp{index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", library
    loop = add(scene, "Loop", None)
    library.objects.link(loop)
    loop.instance_type, loop.instance_collection = "COLLECTION", library
    update()
    assert listed(scene) == [(GROUP, "Library", 0), (LIGHT, "Bulb", 0), *REST]
    row(scene, "Library", GROUP).multiplier = 3.0
    assert rows.mix(scene, ["Bulb", "Bulb#2"])["gains"] == {"Bulb": [3.0] * 3, "Bulb#2": [3.0] * 3}
    row(scene, "Emissive Materials", STATIC).solo = True
    assert rows.mix(scene, ["Bulb#2", "Made by nodes"])["gains"] == {"Bulb#2": SILENT, "Made by nodes": SILENT}


def test_a_renamed_light_keeps_its_row(scene):
    key, other = add_light(scene, "POINT", "Key"), add_light(scene, "POINT", "Other")
    update()
    row(scene, "Key").exposure = 2.0
    key.name, other.name = "Swap", "Key"
    key.name = "Was key"
    update()
    assert row(scene, "Was key").exposure == 2.0 and row(scene, "Key").exposure == 0.0


def test_undo_brings_a_deleted_light_back_with_its_values(scene):
    group = collection(scene, "Rig")
    light_in(group, "Key")
    update()
    row(scene, "Key").multiplier = 3.0
    bpy.ops.ed.undo_push(message="values")
    bpy.data.objects.remove(bpy.data.objects["Key"])
    update()
    bpy.ops.ed.undo_push(message="delete")
    assert listed(scene) == REST and rows.mix(scene, []) == {"gains": {}, "world": NEUTRAL, "static": NEUTRAL}
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    assert row(scene, "Key").multiplier == 3.0
    assert rows.mix(scene, ["Key"])["gains"] == {"Key": [3.0] * 3}
    bpy.ops.ed.redo()
    assert listed(bpy.context.scene) == REST


def test_a_new_light_of_an_old_name_starts_neutral(scene):
    add_light(scene, "POINT", "Key")
    update()
    row(scene, "Key").on = False
    bpy.data.objects.remove(bpy.data.objects["Key"])
    update()
    add_light(scene, "POINT", "Key")
    update()
    assert row(scene, "Key").on


def test_a_reopened_file_has_its_rows(scene, tmp_path):
    group = collection(scene, "Rig")
    light_in(group, "Key")
    light_in(group, "Gone")
    update()
    row(scene, "Key").color = (1.0, 0.5, 0.25)
    row(scene, "Rig", GROUP).solo = True
    row(scene, "Emissive Materials", STATIC).exposure = -1.0
    bpy.data.objects.remove(bpy.data.objects["Gone"])
    update()
    before = rows.mix(scene, ["Key"])
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    scene = bpy.context.scene
    assert rows.mix(scene, ["Key"]) == before and before["gains"]["Key"] == [1.0, 0.5, 0.25]
    assert "Gone" not in {found.name for found in scene.relume_mix.rows}


def test_rows_write_nothing_to_the_lights(scene):
    key = add_light(scene, "POINT", "Key", color=(1.0, 0.9, 0.8))
    update()
    found = row(scene, "Key")
    found.exposure, found.multiplier, found.color, found.use_kelvin, found.on = 3.0, 2.0, (1, 0, 0), True, False
    update()
    assert (key.data.energy, tuple(key.data.color)) == (100.0, pytest.approx((1.0, 0.9, 0.8)))
    assert not key.hide_render and not key.hide_viewport


def test_every_slider_asks_for_an_interactive_picture(scene, tmp_path):
    add_quad(scene)
    add_light(scene, "POINT", "Key")
    scene.relume.folder = str(tmp_path / "bake")
    update()
    start(scene)
    (live,) = FakeLive.made
    edits = {"exposure": 1.0, "multiplier": 3.0, "color": (1.0, 0.5, 0.0), "use_kelvin": True, "kelvin": 3000.0}
    for name, value in {**edits, "solo": True, "on": False}.items():
        before = len(live.requests)
        setattr(row(scene, "Key"), name, value)
        assert len(live.requests) == before + 1, name
        assert live.requests[-1]["interactive"] is True
    assert live.requests[-1]["gains"] == {"Key": SILENT} and live.requests[-1]["static"] == SILENT
    mixer.reset(scene)
    assert live.requests[-1]["gains"] == {"Key": NEUTRAL} and live.requests[-1]["interactive"] is False


def reset_by_operator(scene, found):
    """Makes a row active, and resets it with the button beside it."""
    scene.relume_mix.active = scene.relume_mix.rows.find(found.name)
    assert bpy.ops.relume.reset_row() == {"FINISHED"}


@pytest.mark.parametrize("reset", [lambda scene, found: mixer.reset(scene, [found]), reset_by_operator])
def test_reset_is_for_one_row_or_all(scene, reset):
    for name in ("Key", "Fill"):
        add_light(scene, "POINT", name)
    update()
    for name in ("Key", "Fill"):
        row(scene, name).multiplier = 5.0
    reset(scene, row(scene, "Key"))
    assert (row(scene, "Key").multiplier, row(scene, "Fill").multiplier) == (1.0, 5.0)
    mixer.reset(scene)
    assert row(scene, "Fill").multiplier == 1.0


def test_neither_a_drag_nor_a_slider_walks_the_scene(scene, monkeypatch):
    key = add_light(scene, "POINT", "Key")
    update()
    update()
    monkeypatch.setattr(rows, "sync", None)
    key.location = (1, 2, 3)
    update()
    row(scene, "Key").exposure = 1.0
    update()


def test_a_linked_light_of_the_same_name_has_a_row_of_its_own(scene, tmp_path):
    key = add_light(scene, "POINT", "Key")
    bpy.data.libraries.write(str(tmp_path / "rig.blend"), {key})
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_have, wanted):
        wanted.objects = ["Key"]
    scene.collection.objects.link(wanted.objects[0])
    update()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert listed(bpy.context.scene) == [(LIGHT, "Key", 0), (LIGHT, "Key [rig.blend]", 0), *REST]


def test_the_row_of_a_linked_light_from_before_its_library_was_named_keeps_its_values(scene, tmp_path):
    key = add_light(scene, "POINT", "Key")
    bpy.data.libraries.write(str(tmp_path / "rig.blend"), {key})
    bpy.data.objects.remove(key)
    with bpy.data.libraries.load(str(tmp_path / "rig.blend"), link=True) as (_have, wanted):
        wanted.objects = ["Key"]
    scene.collection.objects.link(wanted.objects[0])
    update()
    row(scene, "Key [rig.blend]").exposure = 2.0
    row(scene, "Key [rig.blend]").name = "Key"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert row(bpy.context.scene, "Key [rig.blend]").exposure == 2.0


def test_a_linked_scene_is_left_alone(scene, tmp_path):
    add_light(scene, "POINT", "Key")
    bpy.data.libraries.write(str(tmp_path / "other.blend"), {scene})
    bpy.ops.wm.read_factory_settings(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "other.blend"), link=True) as (_have, wanted):
        wanted.scenes = ["Scene"]
    (found,) = wanted.scenes
    before = listed(found)
    rows.find_by_name()
    assert found.library and "Key" in found.objects and listed(found) == before, "it had no row for its light"


def test_disabled_and_enabled_again(scene):
    add_light(scene, "POINT", "Key")
    update()
    row(scene, "Key").exposure = 1.0
    addon.unregister()
    assert not hasattr(scene, "relume_mix")
    assert handlers.on_depsgraph_update not in bpy.app.handlers.depsgraph_update_post
    addon.register()
    assert row(scene, "Key").exposure == 1.0


CHANGES = {"on": False, "solo": True, "exposure": 1.0, "multiplier": 2.0, "color": (1.0, 0.5, 0.25)}
CHANGES |= {"use_kelvin": True, "kelvin": 3000.0, "kind": STATIC, "name": "Other", "groups": "", "present": False}


def test_a_mix_is_made_anew_when_a_row_changes_and_not_before(scene, monkeypatch):
    light_in(collection(scene, "Lamps"), "Key")
    add_light(scene, "AREA", "Fill")
    update()
    read, names, key = [], ["Key", "Fill"], row(scene, "Key")
    plain = rows.plain
    monkeypatch.setattr(rows, "plain", lambda *where: read.append(1) or plain(*where))

    def mixed():
        found = rows.mix(scene, names)
        assert found == core.mix_for(names, *plain(scene))
        return found

    assert mixed() is mixed() and len(read) == 1
    row(scene, "Lamps", GROUP).exposure = -1.0
    mixed()
    for name, value in CHANGES.items():
        read.clear()
        with rows.silently():
            setattr(key, name, value)
        assert mixed() is mixed() and len(read) == 1, name
