"""An edit costs what it changes, however many lights there are; many are read in turns."""

import bpy
import pytest

from addon.engine.reading import scene_lights
from addon.engine.reading.scene_lights import SceneLights
from addon.engine.shot import shot
from addon.live import handlers, rows
from addon.live.scheduler import scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_light, row, update
from instances import instancing, scatter, unlinked

MANY = 60


@pytest.fixture
def street(lit):
    """Many lights in a collection, with a started shot; its native module."""
    collection = bpy.data.collections.new("Street")
    lit.collection.children.link(collection)
    for number in range(MANY):
        light = bpy.data.objects.new(f"Lamp {number:02}", bpy.data.lights.new("Lamp", "POINT"))
        collection.objects.link(light)
    update()
    start(lit)
    live = FakeLive.made[-1]
    live.tell(state="ready")
    live.show()
    scheduler.tick()
    return live


@pytest.fixture
def described(monkeypatch):
    """Names of the lights that were read, one after the other."""
    names, describe = [], scene_lights.describe_light

    def noted(obj, *arguments):
        names.append(obj.name)
        return describe(obj, *arguments)

    monkeypatch.setattr(scene_lights, "describe_light", noted)
    return names


def add_another(_lamp):
    add_light(bpy.context.scene, "SPOT", "Another")


def delete_another(_lamp):
    bpy.data.objects.remove(bpy.data.objects["Lamp 30"])


def hide_another(_lamp):
    bpy.data.objects["Lamp 31"].hide_render = True


ONE_EDIT = {
    "drag": (lambda lamp: setattr(lamp, "location", (1, 2, 3)), ["Lamp 07"]),
    "energy": (lambda lamp: setattr(lamp.data, "energy", 5.0), ["Lamp 07"]),
    "ray visibility": (lambda lamp: setattr(lamp, "visible_glossy", False), ["Lamp 07"]),
    "name": (lambda lamp: setattr(lamp, "name", "Moon"), ["Moon"]),
    "another is added": (add_another, ["Another"]),
    "another is deleted": (delete_another, []),
    "another is hidden": (hide_another, []),
    "a row": (lambda lamp: setattr(row(bpy.context.scene, lamp.name), "exposure", 1.0), []),
}


@pytest.mark.parametrize("edit", ONE_EDIT)
def test_an_edit_reads_what_it_changes_and_nothing_else(lit, street, described, edit):
    change, names = ONE_EDIT[edit]
    before = len(street.requests)
    change(bpy.data.objects["Lamp 07"])
    update()
    assert described == names
    assert len(street.requests) == before + 1


@pytest.mark.parametrize("edit", ["drag", "energy", "ray visibility", "a row"])
def test_edits_of_values_do_not_walk_over_the_rows(lit, street, monkeypatch, edit):
    monkeypatch.setattr(rows, "sync", None)
    ONE_EDIT[edit][0](bpy.data.objects["Lamp 07"])
    update()


def test_rows_that_are_due_again_and_again_leave_turns_to_pictures(lit, street, monkeypatch):
    polled, compared = [], []
    monkeypatch.setattr(shot.Shot, "poll", lambda found: polled.append(found))
    monkeypatch.setattr(rows, "are_due", lambda: True)
    monkeypatch.setattr(rows, "sync_due", lambda: compared.append(lit) or True)
    for _ in range(6):
        assert scheduler.tick(), "polling goes on"
    assert len(polled) == len(compared) == 3


def test_an_edit_that_changes_a_row_of_a_light_is_seen(lit, street):
    lamp = bpy.data.objects["Lamp 07"]
    lamp.data.type = "SUN"
    update()
    assert row(lit, "Lamp 07").icon == "LIGHT_SUN"
    lamp.data.type, lamp.data.cycles.is_portal = "AREA", True
    update()
    assert "Lamp 07" not in {found.name for found in rows.present_rows(lit)}
    lamp.data.cycles.is_portal = False
    lamp.data.update_tag()
    update()
    assert row(lit, "Lamp 07").icon == "LIGHT_AREA"


def instance_some(scene):
    """Two instances of a collection with two lights, one of them linked to the plane."""
    library = bpy.data.collections.new("Library")
    for name in ("Bulb", "Tube"):
        library.objects.link(bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA")))
    receivers = bpy.data.objects["Bulb"].light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    receivers.objects.link(bpy.data.objects["Plane"])
    for number in range(2):
        lamp = add(scene, f"Fixture {number}", None)
        lamp.instance_type, lamp.instance_collection = "COLLECTION", library


SERIES = (
    instance_some,
    lambda _scene: setattr(bpy.data.objects["Fixture 1"], "location", (3, 0, 0)),
    lambda _scene: setattr(bpy.data.lights["Bulb"], "energy", 3.0),
    lambda _scene: setattr(bpy.data.objects["Tube"], "location", (0, 0, 1)),
    lambda scene: bpy.data.collections["Receivers"].objects.link(add(scene, "Late", None)),
    lambda _scene: bpy.data.collections["Receivers"].objects.unlink(bpy.data.objects["Plane"]),
    lambda _scene: setattr(bpy.data.objects["Lamp 02"], "data", bpy.data.lights["Tube"]),
    lambda _scene: setattr(bpy.data.objects["Lamp 03"], "parent", bpy.data.objects["Fixture 1"]),
    lambda _scene: setattr(bpy.data.objects["Fixture 1"], "scale", (2, 2, 2)),
    lambda _scene: (setattr(bpy.data.objects["Lamp 04"], "visible_diffuse", False), add_another(None)),
    lambda _scene: setattr(bpy.data.objects["Lamp 05"], "name", "Lamp"),
    lambda _scene: bpy.data.objects.remove(bpy.data.objects["Tube"]),
    lambda _scene: setattr(bpy.data.objects["Fixture 0"], "hide_render", True),
    lambda _scene: setattr(bpy.data.collections["Street"], "hide_render", True),
)


@pytest.mark.parametrize("seconds", [0.0, 60.0], ids=["in turns", "at once"])
def test_what_is_read_bit_by_bit_is_what_would_be_read_anew(lit, street, monkeypatch, seconds):
    monkeypatch.setattr(scheduler, "read_seconds", seconds)
    found = shot.of(lit)
    for number, change in enumerate(SERIES):
        change(lit)
        update()
        while found.lights.is_waiting:
            scheduler.tick()
        anew = SceneLights(found.lights.view_layer, found.lights.receivers)
        anew.read(bpy.context.evaluated_depsgraph_get())
        assert found.lights.descriptions == anew.descriptions, f"after change {number}"
        assert found.lights.warnings == anew.warnings, f"after change {number}"
        assert street.requests[-1]["lights"] == anew.descriptions, f"asked for after change {number}"


def nothing(_scene):
    pass


def instances_of_others(scene):
    """Instances, of which no light is one."""
    scatter(scene.collection, unlinked("Trees", bpy.data.objects["Plane"]))


def hidden_lights(scene):
    """Lights and collections that renders or views lack."""
    bpy.data.objects["Lamp 01"].hide_render = bpy.data.objects["Lamp 02"].hide_viewport = True
    bpy.data.objects["Lamp 03"].hide_set(True)
    aside = bpy.data.collections.new("Aside")
    bpy.data.collections["Street"].children.link(aside)
    for name in ("Lamp 04", "Lamp 05"):
        aside.objects.link(bpy.data.objects[name])
        bpy.data.collections["Street"].objects.unlink(bpy.data.objects[name])
    bpy.context.view_layer.layer_collection.children["Street"].children["Aside"].hide_viewport = True


def linked_to_each_other(scene):
    """A light that hangs from another, and one that lights a collection of lights alone."""
    bpy.data.objects["Lamp 01"].parent = bpy.data.objects["Lamp 02"]
    bpy.data.objects["Lamp 03"].light_linking.receiver_collection = bpy.data.collections["Street"]


@pytest.mark.parametrize("change", [nothing, instances_of_others, hidden_lights, linked_to_each_other])
def test_where_no_light_is_instanced_lights_are_read_by_themselves(lit, street, monkeypatch, change):
    change(lit)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    by_all, by_themselves = (SceneLights(bpy.context.view_layer.name, ["Plane"]) for _ in range(2))
    with monkeypatch.context() as patch:
        patch.setattr(scene_lights, "may_be_instanced", lambda _: True)
        by_all.read(depsgraph)
    by_themselves.read(depsgraph)
    assert by_themselves.descriptions == by_all.descriptions and len(by_all.descriptions) > MANY / 2
    assert by_themselves.warnings == by_all.warnings
    assert not by_themselves.instanced


def of_a_collection_around(scene):
    instancing(scene, bpy.data.collections["Street"])


def of_nodes(scene):
    scatter(scene.collection, bpy.data.objects["Lamp 07"])


def of_points_further_up(scene):
    """Hangs a light from an object that hangs from another, which instances it on its points."""
    outer = add(scene, "Points", bpy.data.objects["Plane"].data)
    outer.instance_type = "VERTS"
    inner = add(scene, "Between", None)
    inner.parent, bpy.data.objects["Lamp 07"].parent = outer, inner


@pytest.mark.parametrize("change", [of_a_collection_around, of_nodes, of_points_further_up])
def test_what_may_instance_a_light_is_noticed(lit, street, change):
    before = len(shot.of(lit).lights.descriptions)
    change(lit)
    update()
    assert shot.of(lit).lights.instanced
    assert len(shot.of(lit).lights.descriptions) > before


def test_many_lights_are_read_in_turns_and_asked_for_once_all_are(lit, street, monkeypatch):
    monkeypatch.setattr(scheduler, "read_seconds", 0.0)
    found, before = shot.of(lit), len(street.requests)
    for obj in lit.objects:
        obj.location.x = 1.0
    update()
    assert found.lights.is_waiting and found.is_busy and found.present_frame is None
    turns = 0
    while found.lights.is_waiting:
        assert len(street.requests) == before, "not with some lights moved and others not"
        assert scheduler.tick(), "polling goes on"
        turns += 1
    assert turns >= MANY / 2
    assert len(street.requests) == before + 1
    assert {light["world_from_object"][0][3] for light in street.requests[-1]["lights"]} == {1.0}


def test_whoever_needs_the_lights_before_gets_them_all(lit, street, monkeypatch):
    monkeypatch.setattr(scheduler, "read_seconds", 0.0)
    for obj in lit.objects:
        obj.location.x = 1.0
    update()
    row(lit, "Key").exposure = 1.0
    assert not shot.of(lit).lights.is_waiting
    assert {light["world_from_object"][0][3] for light in street.requests[-1]["lights"]} == {1.0}
    assert street.requests[-1]["gains"]["Key"] == [2.0] * 3


@pytest.mark.parametrize("way", ["deleted", "undone"])
def test_lights_that_go_while_they_wait_do_no_harm(lit, street, monkeypatch, way):
    bpy.ops.ed.undo_push(message="before")
    monkeypatch.setattr(scheduler, "read_seconds", 0.0)
    add_light(lit, "POINT", "Short-lived")
    for obj in lit.objects:
        obj.location.x = 1.0
    update()
    bpy.ops.ed.undo_push(message="added")
    assert shot.of(lit).lights.is_waiting
    if way == "undone":
        bpy.ops.ed.undo()
    else:
        bpy.data.objects.remove(bpy.data.objects["Short-lived"])
        scheduler.tick()
        update()
    scene = bpy.context.scene
    while shot.of(scene).lights.is_waiting:
        scheduler.tick()
    names = [light["name"] for light in street.requests[-1]["lights"]]
    assert len(names) == MANY + 1 and "Short-lived" not in names


def test_rows_are_compared_in_a_turn_after_the_one_that_undoes(street, monkeypatch):
    turns = []
    monkeypatch.setattr(rows, "sync_due", lambda: turns.append("rows") or False)
    scheduler.tick()
    assert turns == ["rows"]
    handlers.on_undo()
    turns.clear()
    scheduler.tick()
    assert turns == [], "this tick reads lights"
    scheduler.tick()
    assert turns == ["rows"]
