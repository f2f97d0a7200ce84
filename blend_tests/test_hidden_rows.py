"""The rows of lights that are hidden, however they are, say so, and show them again where they can."""

import bpy
import pytest

from addon.core.rows import GROUP
from addon.ui import mixer
from helpers import row, update
from instances import bulb, instancing, newest, unlinked


def rig(scene):
    """A light in a collection of the scene."""
    found = unlinked("Rig")
    scene.collection.children.link(found)
    return bulb(found)


def layer():
    return bpy.context.view_layer.layer_collection.children["Rig"]


def by_the_key_h(scene):
    rig(scene).hide_set(True)


def in_views(scene):
    rig(scene).hide_viewport = True


def in_renders(scene):
    rig(scene).hide_render = True


def by_the_eye_of_its_collection(scene):
    rig(scene)
    layer().hide_viewport = True
    return "'Rig'"


def by_an_excluded_collection(scene):
    rig(scene)
    layer().exclude = True
    return "'Rig'"


def by_its_collection_in_renders(scene):
    rig(scene).users_collection[0].hide_render = True
    return "'Rig'"


def inside_of_an_instance(scene):
    outer, inner = unlinked("Rig"), unlinked("Lamps")
    outer.children.link(inner)
    bulb(inner)
    inner.hide_render = outer.hide_viewport = True
    instancing(scene, outer)
    return "'Lamps' and 'Rig'"


WAYS = [
    *(by_the_key_h, in_views, in_renders, by_the_eye_of_its_collection, by_an_excluded_collection),
    *(by_its_collection_in_renders, inside_of_an_instance),
]


@pytest.mark.parametrize("way", WAYS)
def test_a_light_that_is_hidden_has_no_box_that_is_on(scene, live, way):
    hiding = way(scene)
    made = live()
    assert newest(made) == {} and mixer.is_hidden(scene, row(scene, "Bulb"))
    assert not mixer.is_hidden(scene, row(scene, "Rig", GROUP))
    said = mixer.show_light(bpy.context, "Bulb")
    update()
    assert said == (f"'Bulb' is still hidden, by collection {hiding}" if hiding else None)
    assert mixer.is_hidden(scene, row(scene, "Bulb")) == bool(hiding)
    assert (set(newest(made)) == {"Bulb"}) == (not hiding)


def test_a_light_that_is_gone_is_said(scene, live):
    live()
    assert mixer.show_light(bpy.context, "Bulb") == "'Bulb' is not in this scene any more"


def test_without_a_picture_the_row_tells_of_the_light_itself(scene, registered_for_all_files):
    light = bulb(scene.collection)
    update()
    assert not mixer.is_hidden(scene, row(scene, "Bulb"))
    light.hide_render = True
    update()
    assert mixer.is_hidden(scene, row(scene, "Bulb"))
