"""Edits of real light objects become requests, and only what changed is read."""

import json
import math
import time

import bpy
import pytest
import relume

from addon.engine.reading.render_depsgraph import with_render_depsgraph
from addon.engine.shot import shot
from addon.export import ExportOptions, export_scene
from addon.live.scheduler import DEBOUNCE_SECONDS, scheduler
from addon.ui.start import start
from fake_live import FakeLive
from helpers import add, add_light, row, update

pytestmark = pytest.mark.every_version


@pytest.fixture
def live(lit):
    """A started shot; its native module."""
    start(lit)
    live = FakeLive.made[-1]
    live.tell(state="ready")
    live.show(serial=1)
    scheduler.tick()
    live.requests.clear()
    return live


def newest(live):
    """The lights of the newest request, by name."""
    return {light["name"]: light for light in live.requests[-1]["lights"]}


def test_moving_a_light_asks_at_once_and_again_when_it_rests(lit, live):
    bpy.data.objects["Key"].location.x = 1.0
    update()
    assert [request["interactive"] for request in live.requests] == [True]
    assert newest(live)["Key"]["world_from_object"][0][3] == 1.0
    scheduler.tick()
    assert len(live.requests) == 1
    time.sleep(DEBOUNCE_SECONDS)
    scheduler.tick()
    assert [request["interactive"] for request in live.requests] == [True, False]
    assert newest(live)["Key"]["world_from_object"][0][3] == 1.0


class LightRecorder:
    """A scene builder that keeps the lights."""

    constant_emission = staticmethod(relume.SceneBuilder.constant_emission)

    def __init__(self):
        self.lights = []

    def add_light(self, text):
        self.lights.append(json.loads(text))

    def __getattr__(self, _name):
        return lambda *_arguments, **_options: 0


def test_descriptions_are_those_of_the_export(lit, live):
    key = bpy.data.objects["Key"]
    key.location, key.data.energy, key.data.color = (1, 2, 3), 50.0, (1, 0.5, 0.25)
    key.visible_glossy = False
    rim = add_light(lit, "AREA", name="Rim", shape="ELLIPSE", size=2.0, size_y=0.5)
    rim.light_linking.receiver_collection = bpy.data.collections.new("Receivers")
    rim.light_linking.receiver_collection.objects.link(bpy.data.objects["Plane"])
    update()
    recorder = LightRecorder()
    with_render_depsgraph(lit, lambda _engine, depsgraph, _stop: export_scene(recorder, depsgraph, ExportOptions()))
    assert newest(live) == {light["name"]: light for light in recorder.lights}
    assert newest(live)["Rim"]["receivers"] and newest(live)["Key"]["lobes"]["glossy"] == 0.0


EDITS = {
    "energy": lambda key: setattr(key.data, "energy", 7.0),
    "colour": lambda key: setattr(key.data, "color", (0.1, 0.2, 0.3)),
    "radius": lambda key: setattr(key.data, "shadow_soft_size", 0.9),
    "type": lambda key: setattr(key.data, "type", "SUN"),
    "rotation": lambda key: setattr(key, "rotation_euler", (1.0, 0.0, 0.0)),
    "ray visibility": lambda key: setattr(key, "visible_diffuse", False),
}


@pytest.mark.parametrize("edit", EDITS)
def test_every_edit_of_a_light_is_seen(lit, live, edit):
    EDITS[edit](bpy.data.objects["Key"])
    update()
    assert len(live.requests) == 1


def hide_object(key, _scene):
    key.hide_set(True)


def hide_in_viewports(key, _scene):
    key.hide_viewport = True


def hide_in_renders(key, _scene):
    key.hide_render = True


def hide_collection_in_renders(key, scene):
    collection = bpy.data.collections.new("Lights")
    scene.collection.children.link(collection)
    scene.collection.objects.unlink(key)
    collection.objects.link(key)
    collection.hide_render = True


def exclude_collection(key, scene):
    hide_collection_in_renders(key, scene)
    bpy.data.collections["Lights"].hide_render = False
    scene.view_layers[0].layer_collection.children["Lights"].exclude = True


def delete(key, _scene):
    bpy.data.objects.remove(key)


@pytest.mark.parametrize(
    "hide", [hide_object, hide_in_viewports, hide_in_renders, hide_collection_in_renders, exclude_collection, delete]
)
def test_hidden_and_deleted_lights_are_off(lit, live, hide):
    add_light(lit, "POINT", name="Fill")
    update()
    assert set(newest(live)) == {"Key", "Fill"}
    hide(bpy.data.objects["Key"], lit)
    update()
    assert set(newest(live)) == {"Fill"}


def test_child_of_a_moved_object_moves(lit, live):
    parent = add(lit, "Crane", None)
    bpy.data.objects["Key"].parent = parent
    update()
    parent.location.z = 1.0
    update()
    assert newest(live)["Key"]["world_from_object"][2][3] == pytest.approx(3.0)


def test_instanced_lights_follow_their_instancer(lit, live):
    library = bpy.data.collections.new("Library")
    library.objects.link(bpy.data.objects.new("Bulb", bpy.data.lights.new("Bulb", "POINT")))
    lamps = [add(lit, f"Lamp{index}", None) for index in range(2)]
    for lamp in lamps:
        lamp.instance_type, lamp.instance_collection = "COLLECTION", library
    update()
    assert set(newest(live)) == {"Key", "Bulb", "Bulb#2"}
    lamps[1].location.x = 5.0
    update()
    assert sorted(light["world_from_object"][0][3] for light in newest(live).values()) == [0.0, 0.0, 5.0]
    bpy.data.lights["Bulb"].energy = 3.0
    update()
    assert newest(live)["Bulb"]["energy"] == newest(live)["Bulb#2"]["energy"] == 3.0
    lamps[0].hide_render = True
    update()
    assert set(newest(live)) == {"Key", "Bulb"}


def test_other_edits_ask_for_nothing(lit, live):
    bpy.data.objects["Plane"].location.x = 1.0
    lit.relume.samples = 100
    update()
    assert live.requests == []


def test_undo_is_followed(lit, live):
    bpy.ops.ed.undo_push(message="before")
    bpy.data.objects["Key"].location.x = 1.0
    update()
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert newest(live)["Key"]["world_from_object"][0][3] == 0.0
    bpy.ops.ed.redo()
    assert newest(live)["Key"]["world_from_object"][0][3] == 1.0


def test_a_renamed_light_is_renamed(lit, live):
    bpy.data.objects["Key"].name = "Sun"
    update()
    assert set(newest(live)) == {"Sun"}


def test_retyped_light_data_is_read(lit, live):
    bpy.data.objects["Key"].data = bpy.data.lights.new("Other", "AREA")
    update()
    assert newest(live)["Key"]["kind"]["type"] == "AREA"
    bpy.data.lights["Other"].energy = 4.5
    update()
    assert newest(live)["Key"]["energy"] == 4.5


def test_a_light_hidden_in_the_view_only_is_said_to_be_in_renders(lit, live):
    bpy.data.objects["Key"].hide_set(True)
    update()
    notes = shot.of(lit).notes
    assert any("'Key' is hidden in the view only" in note for note in notes)
    bpy.data.objects["Key"].hide_render = True
    update()
    assert not any("hidden in the view only" in note for note in shot.of(lit).notes)


IMPOSSIBLE = {
    "no scale": (lambda light: setattr(light, "scale", (0, 0, 0)), "its scale is zero"),
    "no place": (lambda light: setattr(light, "location", (math.nan, 0, 0)), "not a number"),
    "endless energy": (lambda light: setattr(light.data, "energy", math.inf), "not a number"),
}


@pytest.mark.parametrize("kind", IMPOSSIBLE)
def test_a_light_that_cannot_shine_is_left_out_by_name(lit, live, kind):
    edit, words = IMPOSSIBLE[kind]
    light = add_light(lit, "AREA", name="Odd")
    edit(light)
    update()
    assert [description["name"] for description in shot.of(lit).lights.descriptions] == ["Key"]
    assert any("'Odd'" in note and words in note for note in shot.of(lit).notes)
    light.scale, light.location, light.data.energy = (1, 1, 1), (0, 0, 1), 10.0
    update()
    assert set(newest(live)) == {"Key", "Odd"}
    assert not any("'Odd'" in note for note in shot.of(lit).notes)


def test_a_refused_request_is_said_and_forgotten_with_the_next(lit, live, monkeypatch):
    def refuse(_request):
        raise ValueError("light 1 'Key': broken")

    with monkeypatch.context() as patched:
        patched.setattr(live, "relight", refuse)
        bpy.data.objects["Key"].location.x = 1.0
        update()
        assert shot.of(lit).notes[0] == "light 1 'Key': broken"
    bpy.data.objects["Key"].location.x = 2.0
    update()
    assert shot.of(lit).notes == []
    assert newest(live)["Key"]["world_from_object"][0][3] == 2.0


def test_what_is_only_evaluated_again_asks_for_nothing(lit, live):
    for obj in lit.objects:
        obj.update_tag()
    bpy.data.lights["Key"].update_tag()
    lit.update_tag()
    update()
    scheduler.request_picture(lit, interactive=True)
    scheduler.request_picture(lit)
    assert live.requests == [] and not scheduler.settling


def test_lights_of_one_name_are_told_apart(lit, live, tmp_path):
    """A light of this file and one of a library can be called the same: each has its own row and gain."""
    path = str(tmp_path / "rig.blend")
    bpy.data.libraries.write(path, {bpy.data.objects["Key"]})
    with bpy.data.libraries.load(path, link=True) as (_have, wanted):
        wanted.objects = ["Key"]
    lit.collection.objects.link(wanted.objects[0])
    update()
    assert sorted(newest(live)) == ["Key", "Key [rig.blend]"]
    row(lit, "Key [rig.blend]").exposure = 1.0
    row(lit, "Key").on = False
    assert live.requests[-1]["gains"] == {"Key": [0.0] * 3, "Key [rig.blend]": [2.0] * 3}
