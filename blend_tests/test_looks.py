"""Looks come back as they were, in this file and in others, and are compared in the overlay."""

import json
import math
from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.apply.writable import RefusedError
from addon.core import receivers
from addon.core.looks import Look, LookError, from_json, match, to_json
from addon.core.rows import GROUP, Row
from addon.engine import shot
from addon.ui import compare, handlers, looks, rows, thumbnails
from addon.ui.start import start
from addon.viewport import compare as pairs
from addon.viewport import view_table
from fake_live import FakeLive
from helpers import add_light, add_quad, row, update

pytestmark = pytest.mark.usefixtures("registered_for_all_files")


@pytest.fixture
def lit(scene, tmp_path):
    """A key, a fill in a rig, and a folder to bake into."""
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


def dial(scene):
    """A state worth keeping."""
    key = row(scene, "Key")
    key.exposure, key.color, key.use_kelvin, key.kelvin = 1.5, (1.0, 0.5, 0.25), True, 3000.0
    row(scene, "Rig", GROUP).multiplier = 0.5
    row(scene, "Fill").solo = True


def values(scene):
    """All rows as plain data."""
    return {(found.kind, found.name): found.values() for found in rows.present_rows(scene)}


def scene_state(scene):
    """All that a look may write to lights."""
    return {
        obj.name: (
            obj.data.type,
            obj.data.energy,
            tuple(obj.data.color),
            np.round(np.array(obj.matrix_world), 5).tolist(),
            getattr(obj.data, "size", None),
            getattr(obj.data, "shape", None),
            obj.hide_render,
        )
        for obj in scene.objects
        if obj.type == "LIGHT"
    }


def test_restoring_brings_rows_back_and_writes_nothing_to_lights(lit):
    dial(lit)
    kept = values(lit)
    looks.snapshot(lit)
    rows.reset(lit)
    bpy.data.objects["Key"].data.energy = 7.0
    before = scene_state(lit)
    assert bpy.ops.relume.restore_look() == {"FINISHED"}
    assert values(lit) == kept and scene_state(lit) == before


def move_everything(scene):
    """Other lights than before in every respect."""
    key, fill = bpy.data.objects["Key"], bpy.data.objects["Fill"]
    key.location, key.rotation_euler, key.scale = (5, 5, 5), (1, 0.5, 0), (2, 3, 1)
    key.data.energy, key.data.shape, key.data.size = 1.0, "SQUARE", 3.0
    fill.data.type = "SUN"
    fill.data.energy, fill.hide_render = 3.0, True
    update()


def test_lights_come_back_in_one_undo_step(lit):
    before = scene_state(lit)
    looks.snapshot(lit)
    move_everything(lit)
    moved = scene_state(lit)
    bpy.ops.ed.undo_push(message="moved")
    assert bpy.ops.relume.restore_look("EXEC_DEFAULT", lights=True) == {"FINISHED"}
    bpy.ops.ed.undo_push(message="restored")  # As the window does after an operator.
    update()
    assert scene_state(bpy.context.scene) == before
    bpy.ops.ed.undo()
    assert scene_state(bpy.context.scene) == moved


def test_a_child_of_a_moved_parent_comes_back_to_its_place(lit):
    parent = bpy.data.objects.new("Parent", None)
    lit.collection.objects.link(parent)
    key = bpy.data.objects["Key"]
    key.parent = parent
    parent.location = (1, 0, 0)
    update()
    looks.snapshot(lit)
    before = np.array(key.matrix_world)
    parent.rotation_euler = (0, 0, math.pi / 2)
    update()
    assert not np.allclose(key.matrix_world, before, atol=1e-3)
    looks.restore(lit, looks.active_look(lit).look(), lights=True)
    update()
    assert np.allclose(key.matrix_world, before, atol=1e-5)


@pytest.fixture
def hung(lit):
    """The fill hangs on the key, and a bulb on the fill by an empty between them; all stand askew."""
    add_light(lit, "POINT", "Bulb", location=(0.3, 0.1, -0.4), shadow_soft_size=0.1)
    arm = bpy.data.objects.new("Arm", None)
    lit.collection.objects.link(arm)
    chain = [bpy.data.objects[name] for name in ("Key", "Fill", "Arm", "Bulb")]
    for parent, child in zip(chain, chain[1:], strict=False):
        child.parent = parent
        child.rotation_euler = (0.2, 0.1, 0.4)
    update()
    return lit


def places(*names):
    """Of objects in the scene."""
    update()
    return [np.array(bpy.data.objects[name].matrix_world) for name in names]


@pytest.mark.parametrize("is_reversed", [False, True])
def test_lights_that_hang_on_lights_come_back_to_their_places(hung, is_reversed):
    look = looks.snapshot(hung).look()
    look = replace(look, lights=tuple(sorted(look.lights, key=lambda light: light["name"], reverse=is_reversed)))
    before = places("Key", "Fill", "Bulb")
    for name in ("Key", "Fill", "Bulb"):
        bpy.data.objects[name].location.x += 1.0
        bpy.data.objects[name].rotation_euler.z += 0.5
    update()
    looks.restore(hung, look, lights=True)
    assert np.allclose(places("Key", "Fill", "Bulb"), before, atol=1e-5)


def solved_key(scene, **changes):
    """A look that moves the key alone, as solving makes them."""
    look = looks.snapshot(scene).look()
    state = next(light for light in look.lights if light["name"] == "Key")
    moved = [[*row[:3], row[3] + 1.0] for row in state["matrix"][:3]] + [state["matrix"][3]]
    return replace(look, lights=(state | {"matrix": moved} | changes,))


def test_lights_that_hang_on_one_that_moves_stay_where_they_are(hung):
    key, fill, bulb = places("Key", "Fill", "Bulb")
    bpy.data.objects["Bulb"].keyframe_insert("location")  # Nothing is to be written: the fill has come back.
    looks.restore(hung, solved_key(hung), lights=True)
    found = places("Key", "Fill", "Bulb")
    assert np.allclose(found[0][:3, 3], key[:3, 3] + 1.0, atol=1e-5)
    assert np.allclose(found[1:], [fill, bulb], atol=1e-5)


def test_a_rig_that_comes_along_writes_nothing_to_its_lights(hung):
    look = looks.snapshot(hung).look()
    before = places("Key", "Fill", "Bulb")
    bpy.data.objects["Key"].location.x += 2.0
    bpy.data.objects["Bulb"].keyframe_insert("location")  # Could not be written, and need not.
    update()
    looks.restore(hung, look, lights=True)
    assert np.allclose(places("Key", "Fill", "Bulb"), before, atol=1e-5)


def test_a_light_that_could_not_be_kept_in_its_place_is_refused_by_name(hung):
    bpy.data.objects["Fill"].keyframe_insert("location")
    before = scene_state(hung)
    says = "light 'Fill' hangs on a light that moves, and has animation on its location"
    with pytest.raises(RefusedError, match=says):
        looks.restore(hung, solved_key(hung), lights=True)
    assert scene_state(hung) == before


def constrained(_scene):
    bpy.data.objects["Key"].constraints.new("COPY_LOCATION").name = "Follow"
    return "light 'Key' is placed by its constraint 'Follow'"


def driven(_scene):
    bpy.data.objects["Key"].data.driver_add("size")
    return "light 'Key' has a driver on its size"


def animated(_scene):
    bpy.data.objects["Key"].keyframe_insert("location")
    return "light 'Key' has animation on its location"


@pytest.mark.parametrize("spoil", [constrained, driven, animated])
def test_what_cannot_be_written_is_refused_by_name_and_nothing_is(lit, spoil):
    looks.snapshot(lit)
    dial(lit)
    move_everything(lit)
    says = spoil(lit)
    update()
    before = values(lit), scene_state(lit)
    with pytest.raises(RefusedError, match=says):
        looks.restore(lit, looks.active_look(lit).look(), lights=True)
    assert (values(lit), scene_state(lit)) == before


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"type": "LASER"}, "cannot be of type 'LASER'"),
        ({"type": "point"}, "cannot be of type 'point'"),
        ({"type": ""}, "cannot be of type ''"),
        ({"settings": {"shape": "STAR"}}, "cannot have 'STAR' as its shape"),
        ({"settings": {"energy": [1.0, 2.0, 3.0]}}, r"cannot have \[1.0, 2.0, 3.0\] as its energy"),
        ({"settings": {"color": 1.0}}, "cannot have 1.0 as its color"),
        ({"settings": {"energy": True}}, "cannot have True as its energy"),
    ],
)
def test_hostile_values_are_refused_before_anything_is_written(lit, change, says):
    data = json.loads(to_json(looks.snapshot(lit).look()))
    light = next(light for light in data["lights"] if light["name"] == "Key")
    light |= change
    other = next(light for light in data["lights"] if light["name"] == "Fill")
    other["settings"]["energy"] = 3.0
    before = scene_state(lit)
    with pytest.raises(RefusedError, match=says):
        looks.restore(lit, from_json(json.dumps(data)), lights=True)
    assert scene_state(lit) == before


def test_lights_that_a_look_does_not_know_are_switched_off_and_said(lit):
    look = looks.snapshot(lit).look()
    add_light(lit, "POINT", "Rim")
    bpy.data.objects.remove(bpy.data.objects["Fill"])
    update()
    outcome = looks.restore(lit, look)
    assert not row(lit, "Rim").on and row(lit, "Key").on
    assert str(outcome) == "not in this scene: Rig, Fill; not in the look, so switched off: Rim"


def test_looks_are_named_renamed_deleted_and_saved(lit, tmp_path):
    for _ in range(3):
        assert bpy.ops.relume.snapshot() == {"FINISHED"}
    state = lit.relume_looks
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


def test_a_file_serves_another_scene(lit, tmp_path):
    dial(lit)
    looks.snapshot(lit, "Dusk")
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
def test_a_bad_file_is_one_clear_line_and_adds_nothing(lit, tmp_path, content, says):
    path = tmp_path / "bad.json"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RuntimeError, match=says):
        bpy.ops.relume.import_look(filepath=str(path))
    with pytest.raises((LookError, OSError)):
        looks.import_file(lit, path)
    assert len(lit.relume_looks.items) == 0


def test_a_file_of_a_stranger_is_refused(lit, tmp_path):
    data = json.loads(to_json(looks.snapshot(lit).look()))
    for found in data["rows"]:
        found["name"] = f"Other {found['name']}"
    path = tmp_path / "stranger.json"
    path.write_text(json.dumps(data))
    with pytest.raises(RuntimeError, match="none of this scene's lights"):
        bpy.ops.relume.import_look(filepath=str(path))


def test_a_failed_export_leaves_no_file(lit, tmp_path):
    look = looks.snapshot(lit).look()
    with pytest.raises(OSError):
        looks.export_file(look, tmp_path / "none" / "look.json")
    assert not (tmp_path / "none").exists()


def test_a_thumbnail_is_the_picture_under_the_scenes_view(lit):
    lit.view_settings.view_transform = "AgX"
    start(lit)
    (live,) = FakeLive.made
    live.show()
    image = np.ones((300, 480, 4), np.float32)
    image[150:, :, 0] = 4.0  # The upper half is red.
    live.newest.image = image
    handlers.tick()
    entry = looks.snapshot(lit)
    pixels = thumbnails.decode(entry.thumbnail)
    assert pixels.shape == (100, 160, 3)
    assert pixels[10, 10].tolist() == [197, 197, 197], "1.0 in AgX"
    assert pixels[90, 10, 0] > 220 > pixels[90, 10, 1]
    assert len(entry.thumbnail) < 4000
    assert thumbnails.icon(entry.uid, entry.thumbnail) >= 0 and thumbnails.icon("other", "") == 0


@pytest.mark.parametrize("size", [(1, 1), (3, 1000), (1000, 3), (540, 960)])
def test_thumbnails_of_odd_sizes(lit, size):
    image = np.full((*size, 4), np.inf, np.float32)
    image[0, 0] = np.nan
    height, width = thumbnails.decode(thumbnails.encode(lit, image)).shape[:2]
    assert 1 <= width <= thumbnails.WIDTH and height >= 1


def test_thumbnails_in_a_known_view_are_the_same(lit):
    image = np.ones((100, 160, 4), np.float32)
    image[..., :3] = np.exp2(np.linspace(-6.0, 4.0, 160))[:, None]
    slow = thumbnails.decode(thumbnails.encode(lit, image))
    view_table.complete(lit)
    quick = thumbnails.decode(thumbnails.encode(lit, image))
    view_table.clear()
    assert np.abs(slow.astype(int) - quick).max() <= 1 and slow.std() > 20


@pytest.fixture
def compared(lit, monkeypatch):
    """Two looks of an open shot, and the pairs that the overlay got."""
    shown = []
    monkeypatch.setattr(pairs, "set_pair", lambda scene, *pair: shown.append(pair))
    start(lit)
    FakeLive.made[-1].show()
    handlers.tick()
    looks.snapshot(lit, "One")
    bpy.data.objects["Key"].location = (9, 9, 9)
    update()
    row(lit, "Key").exposure = 2.0
    looks.snapshot(lit, "Two")
    return lit, FakeLive.made[-1], shown


def place_of_key(request):
    """Where a request has the key light."""
    return next(light["world_from_object"][0][3] for light in request["lights"] if light["name"] == "Key")


def answer(live, comparison, **how):
    """A picture of the newest request arrives."""
    live.show(serial=live.newest.serial + 1 if live.newest else 1, **how)
    handlers.tick()
    return comparison.step()


def test_two_looks_are_compared_as_they_were_made(compared):
    scene, live, shown = compared
    items = scene.relume_looks.items
    row(scene, "Key").on = False
    comparison = compare.start(scene, [items["One"], items["Two"]])
    one = live.requests[-1]
    assert comparison.step() and answer(live, comparison)
    two = live.requests[-1]
    assert not answer(live, comparison)
    ((a, b, mode, labels),) = shown
    assert (a.serial, b.serial, mode, labels) == (2, 3, "WIPE", ("One", "Two"))
    assert [place_of_key(request) for request in (one, two)] == [1.0, 9.0]
    assert (one["gains"]["Key"], two["gains"]["Key"]) == ([1.0] * 3, [4.0] * 3)
    assert live.requests[-1]["gains"]["Key"] == [0.0] * 3, "the live picture is asked for again"
    compare.stop(scene)
    assert pairs.pair_of(scene) is None


def test_a_comparison_keeps_the_polling_awake(compared, monkeypatch):
    scene, live, _shown = compared
    woken = []
    monkeypatch.setattr(handlers, "wake", lambda: woken.append(len(live.requests)))
    items = scene.relume_looks.items
    comparison = compare.start(scene, [items["One"], items["Two"]])
    assert woken[-1] == len(live.requests), "after the first request"
    answer(live, comparison)
    assert woken[-1] == len(live.requests), "and after the second"


def test_one_look_is_compared_with_the_live_picture(compared):
    scene, live, shown = compared
    scene.relume_looks.active, scene.relume_looks.other = 0, ""
    assert bpy.ops.relume.compare_looks() == {"FINISHED"}
    assert not answer(live, compare.running(scene))
    assert shown[0][0].serial == 2 and shown[0][1] is None and shown[0][3] == ("One", "Now")


def test_a_newer_request_does_not_get_into_a_comparison(compared):
    scene, live, shown = compared
    comparison = compare.start(scene, [scene.relume_looks.items["One"]])
    wanted = live.requests[-1]
    row(scene, "Key").exposure = 5.0
    assert answer(live, comparison) and not shown, "asked for again"
    assert live.requests[-1] == wanted
    assert answer(live, comparison, scale=2) and not shown, "not at half size"
    assert not answer(live, comparison) and len(shown) == 1


def test_an_imported_look_is_compared_with_the_present_lights(compared, tmp_path):
    scene, live, _shown = compared
    looks.export_file(scene.relume_looks.items["One"].look(), tmp_path / "one.json")
    entry, _outcome = looks.import_file(scene, tmp_path / "one.json")
    compare.start(scene, [entry])
    assert live.requests[-1]["gains"] == {"Key": [1.0] * 3, "Fill": [1.0] * 3}
    assert place_of_key(live.requests[-1]) == 9.0


def test_a_look_shines_on_the_same_objects_in_a_bake_that_counts_them_anew(compared):
    scene, live, _shown = compared
    linked = bpy.data.collections.new("Lit")
    linked.objects.link(bpy.data.objects["Plane"])
    bpy.data.objects["Key"].light_linking.receiver_collection = linked
    update()
    handlers.read_lights(scene)
    looks.snapshot(scene, "Linked")
    bpy.data.objects["Key"].light_linking.receiver_collection = None
    update()
    found = shot.of(scene)
    objects = found.lights.receivers
    found.lights.receivers = ["New", *reversed(objects)]
    compare.start(scene, [scene.relume_looks.items["Linked"]])
    (number,) = receivers_of_key(live.requests[-1])
    assert found.lights.receivers[number] == "Plane"
    found.lights.receivers = ["New"]
    compare.start(scene, [scene.relume_looks.items["Linked"]])
    assert receivers_of_key(live.requests[-1]) == [], "the plane is not in this bake"


def test_a_look_from_before_objects_were_named_is_asked_for_as_it_is(compared):
    scene, live, _shown = compared
    entry = scene.relume_looks.items["One"]
    old = json.loads(entry.request)
    old["lights"][0]["receivers"] = {"receivers": [0, 2]}
    entry.request = json.dumps(old)
    compare.start(scene, [entry])
    assert live.requests[-1]["lights"][0]["receivers"] == {"receivers": [0, 2]}


def test_links_survive_names_and_numbers():
    objects = [f"object {number}" for number in range(2060)]
    for numbers in ([], [3], [0, 5, 2047], list(range(2048)), [number for number in range(2048) if number != 7]):
        request = json.dumps({"lights": [{"name": "Key", "receivers": {"receivers": numbers}}, {"name": "Fill"}]})
        named = receivers.with_names(request, objects)
        assert json.loads(receivers.with_numbers(named, objects)) == json.loads(request)
    without = receivers.with_numbers(named, ["New", *objects[:20]])
    assert json.loads(without)["lights"][0]["receivers"] == {"receivers": [0, *range(1, 8), *range(9, 21)]}


def test_a_look_meets_lights_that_are_linked_in_one_file_and_not_in_the_other():
    made = [Row("Key", exposure=1.0), Row("Key [rig.blend]", exposure=2.0), Row("Fill [rig.blend]", exposure=3.0)]
    found = match(Look("Look", tuple(made)), [Row("Key"), Row("Key [other.blend]"), Row("Fill"), Row("Rim")])
    assert [row.exposure for row in found.rows] == [1.0, 2.0, 3.0, 0.0]
    assert (found.missing, found.unknown) == ([], ["Rim"])


def receivers_of_key(request):
    return next(light["receivers"]["receivers"] for light in request["lights"] if light["name"] == "Key")


def test_comparing_needs_a_shot_and_ends_with_it(compared):
    scene, _live, shown = compared
    comparison = compare.start(scene, [scene.relume_looks.items["One"]])
    shot.close_all()
    assert not comparison.step() and not shown
    with pytest.raises(RuntimeError, match="press Start first"):
        bpy.ops.relume.compare_looks()
    start(scene)
    with pytest.raises(RuntimeError, match="wait for the first picture"):
        bpy.ops.relume.compare_looks()


def test_another_file_ends_comparing(compared):
    scene, _live, _shown = compared
    comparison = compare.start(scene, [scene.relume_looks.items["One"]])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert compare.running(bpy.context.scene) is None and not comparison.step() and pairs.frames() == []
