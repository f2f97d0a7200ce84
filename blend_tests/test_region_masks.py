"""Masks of what renders show: rays pass what the window alone shows, and what it hides is named."""

import bpy
import pytest

from addon.engine.solve.region_masks import MaskSubject, masks, not_shown
from addon.ui.solve import operators
from fake_solve import FakeJob
from helpers import add, add_material, add_quad, update

VASE = MaskSubject("OBJECT", "Vase")


@pytest.fixture
def vase(scene):
    """Adds the object that the camera looks at."""
    obj = add_quad(scene, "Vase", 0.5)
    update()
    return obj


def count(scene, seen=VASE):
    """Rays that see it."""
    *_slices, found = masks(scene.session_uid, [seen], 4 / 3)
    return int(found[seen].sum())


def box(scene):
    """Around all that is seen, and the camera."""
    bpy.ops.mesh.primitive_cube_add(size=3.0)
    obj = bpy.context.object
    obj.name = "Within"
    return obj


def hidden_itself(_scene, within):
    within.hide_render = True


def hidden_from_the_camera(_scene, within):
    within.visible_camera = False


def in_a_hidden_collection(scene, within):
    outer, inner = bpy.data.collections.new("Helpers"), bpy.data.collections.new("Boxes")
    scene.collection.children.link(outer)
    outer.children.link(inner)
    inner.objects.link(within)
    scene.collection.objects.unlink(within)
    outer.hide_render = True


def instanced(scene, within):
    rig = bpy.data.collections.new("Rig")
    rig.objects.link(within)
    scene.collection.objects.unlink(within)
    empty = add(scene, "Instances", None)
    empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", rig, (0.1, 0.0, 0.05)
    return empty


def instance_of_what_is_hidden(scene, within):
    instanced(scene, within)
    within.hide_render = True


def instance_by_what_is_hidden(scene, within):
    instanced(scene, within).hide_render = True


WAYS = [
    *(hidden_itself, hidden_from_the_camera, in_a_hidden_collection),
    *(instance_of_what_is_hidden, instance_by_what_is_hidden),
]


@pytest.mark.parametrize("hide", WAYS)
def test_rays_pass_what_no_render_shows(scene, vase, hide):
    free = count(scene)
    within = box(scene)
    update()
    assert free > 100 and count(scene) == 0
    hide(scene, within)
    update()
    assert count(scene) == free


def test_an_instance_that_renders_show_is_met(scene, vase):
    within = box(scene)
    instanced(scene, within)
    other = add(scene, "Other", within.data)
    other.hide_render = True
    update()
    assert count(scene) == 0


def by_its_eye(_scene, obj):
    obj.hide_set(True)


def in_all_views(_scene, obj):
    obj.hide_viewport = True


@pytest.mark.parametrize("hide", [by_its_eye, in_all_views])
def test_what_the_window_alone_hides_is_named(scene, vase, hide):
    material = add_material("Clay")[0]
    material.pass_index = vase.pass_index = 4
    vase.data.materials.append(material)
    wanted = [VASE, MaskSubject("MATERIAL", "Clay"), MaskSubject("OBJECT_INDEX", 4), MaskSubject("MATERIAL_INDEX", 4)]
    assert [not_shown(scene, seen) for seen in wanted] == [[]] * 4
    hide(scene, vase)
    update()
    assert [not_shown(scene, seen) for seen in wanted] == [["Vase"]] * 4 and count(scene) == 0
    assert not_shown(scene, MaskSubject("OBJECT", "Nobody")) == []
    vase.hide_render = True
    assert not_shown(scene, VASE) == [], "it is in no render either"


def ask_for_the_plane(scene):
    bpy.ops.relume.add_region(kind="OBJECT")
    scene.relume_solve.regions[0].object = scene.objects["Plane"]


def test_solving_for_what_the_window_hides_says_so(baked):
    ask_for_the_plane(baked)
    baked.objects["Plane"].hide_set(True)
    update()
    with pytest.raises(RuntimeError, match="Not seen in the picture: object 'Plane', since 'Plane' is hidden in the"):
        bpy.ops.relume.solve()


def test_solving_for_a_part_says_so(baked):
    material = add_material("Clay")[0]
    baked.objects["Plane"].data.materials.append(material)
    add_quad(baked, "Other", material=material).hide_set(True)
    update()
    bpy.ops.relume.add_region(kind="MATERIAL")
    baked.relume_solve.regions[0].material = material
    found = operators.begin(baked)
    while not FakeJob.made:
        found.step()
    assert "Only a part of material 'Clay' is looked at, since 'Other' is hidden in the view" in found.notes[-1]
    found.cancel()
