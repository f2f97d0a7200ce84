"""Looks are compared in the overlay, as they were made."""

import json

import bpy
import pytest

from addon.core import receivers
from addon.core.looks import Look, match
from addon.core.rows import Row
from addon.engine.shot import shot
from addon.live import comparison as comparing
from addon.live.scheduler import scheduler
from addon.ui import looks
from addon.ui.start import start
from addon.viewport import compare as pairs
from fake_live import FakeLive
from helpers import row, update


@pytest.fixture
def compared(rigged, monkeypatch):
    """Two looks of an open shot, and the pairs that the overlay got."""
    shown = []
    monkeypatch.setattr(pairs, "set_pair", lambda scene, *pair: shown.append(pair))
    start(rigged)
    FakeLive.made[-1].show()
    scheduler.tick()
    looks.snapshot(rigged, "One")
    bpy.data.objects["Key"].location = (9, 9, 9)
    update()
    row(rigged, "Key").exposure = 2.0
    looks.snapshot(rigged, "Two")
    return rigged, FakeLive.made[-1], shown


def place_of_key(request):
    """Where a request has the key light."""
    return next(light["world_from_object"][0][3] for light in request["lights"] if light["name"] == "Key")


def answer(live, comparison, **how):
    """A picture of the newest request arrives."""
    live.show(serial=live.newest.serial + 1 if live.newest else 1, **how)
    scheduler.tick()
    return comparison.step()


def test_two_looks_are_compared_as_they_were_made(compared):
    scene, live, shown = compared
    items = scene.relume_looks.items
    row(scene, "Key").on = False
    comparison = comparing.start(scene, [items["One"], items["Two"]])
    one = live.requests[-1]
    assert comparison.step() and answer(live, comparison)
    two = live.requests[-1]
    assert not answer(live, comparison)
    ((a, b, mode, labels),) = shown
    assert (a.serial, b.serial, mode, labels) == (2, 3, "WIPE", ("One", "Two"))
    assert [place_of_key(request) for request in (one, two)] == [1.0, 9.0]
    assert (one["gains"]["Key"], two["gains"]["Key"]) == ([1.0] * 3, [4.0] * 3)
    assert live.requests[-1]["gains"]["Key"] == [0.0] * 3, "the live picture is asked for again"
    comparing.stop(scene)
    assert pairs.pair_of(scene) is None


def test_a_comparison_keeps_the_polling_awake(compared, monkeypatch):
    scene, live, _shown = compared
    woken = []
    monkeypatch.setattr(scheduler, "wake", lambda: woken.append(len(live.requests)))
    items = scene.relume_looks.items
    comparison = comparing.start(scene, [items["One"], items["Two"]])
    assert woken[-1] == len(live.requests), "after the first request"
    answer(live, comparison)
    assert woken[-1] == len(live.requests), "and after the second"


def test_one_look_is_compared_with_the_live_picture(compared):
    scene, live, shown = compared
    scene.relume_looks.active, scene.relume_looks.other = 0, ""
    assert bpy.ops.relume.compare_looks() == {"FINISHED"}
    assert not answer(live, comparing.running(scene))
    assert shown[0][0].serial == 2 and shown[0][1] is None and shown[0][3] == ("One", "Now")


def test_a_newer_request_does_not_get_into_a_comparison(compared):
    scene, live, shown = compared
    comparison = comparing.start(scene, [scene.relume_looks.items["One"]])
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
    comparing.start(scene, [entry])
    assert live.requests[-1]["gains"] == {"Key": [1.0] * 3, "Fill": [1.0] * 3}
    assert place_of_key(live.requests[-1]) == 9.0


def test_a_look_shines_on_the_same_objects_in_a_bake_that_counts_them_anew(compared):
    scene, live, _shown = compared
    linked = bpy.data.collections.new("Lit")
    linked.objects.link(bpy.data.objects["Plane"])
    bpy.data.objects["Key"].light_linking.receiver_collection = linked
    update()
    scheduler.read_lights(scene)
    looks.snapshot(scene, "Linked")
    bpy.data.objects["Key"].light_linking.receiver_collection = None
    update()
    found = shot.of(scene)
    objects = found.lights.receivers
    found.lights.receivers = ["New", *reversed(objects)]
    comparing.start(scene, [scene.relume_looks.items["Linked"]])
    (number,) = receivers_of_key(live.requests[-1])
    assert found.lights.receivers[number] == "Plane"
    found.lights.receivers = ["New"]
    comparing.start(scene, [scene.relume_looks.items["Linked"]])
    assert receivers_of_key(live.requests[-1]) == [], "the plane is not in this bake"


def test_a_look_from_before_objects_were_named_is_asked_for_as_it_is(compared):
    scene, live, _shown = compared
    entry = scene.relume_looks.items["One"]
    old = json.loads(entry.request)
    old["lights"][0]["receivers"] = {"receivers": [0, 2]}
    entry.request = json.dumps(old)
    comparing.start(scene, [entry])
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
    comparison = comparing.start(scene, [scene.relume_looks.items["One"]])
    shot.close_all()
    assert not comparison.step() and not shown
    with pytest.raises(RuntimeError, match="press Start first"):
        bpy.ops.relume.compare_looks()
    start(scene)
    with pytest.raises(RuntimeError, match="wait for the first picture"):
        bpy.ops.relume.compare_looks()


def test_another_file_ends_comparing(compared):
    scene, _live, _shown = compared
    comparison = comparing.start(scene, [scene.relume_looks.items["One"]])
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert comparing.running(bpy.context.scene) is None and not comparison.step() and pairs.frames() == []
