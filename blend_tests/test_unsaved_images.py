"""Painted images that are not saved are in no copy of the file: who would render one says so, by name."""

import bpy
import pytest

from addon.engine.cycles import verify
from addon.engine.shot import background
from addon.engine.workers import unsaved_images
from addon.engine.workers.process import NoCopyError, SavedCopy
from helpers import add, add_material, add_quad, add_world

pytestmark = pytest.mark.every_version


@pytest.fixture
def image():
    """Painted, not saved."""
    found = bpy.data.images.new("Poster", 8, 8)
    found.pixels[0] = 1.0
    assert found.is_dirty
    return found


def material_of(image):
    """A material with the image in a group of nodes."""
    material, tree, _output = add_material("Wall")
    group = bpy.data.node_groups.new("Inside", "ShaderNodeTree")
    group.nodes.new("ShaderNodeTexImage").image = image
    tree.nodes.new("ShaderNodeGroup").node_tree = group
    return material


def on_an_object(scene, image):
    add_quad(scene, material=material_of(image))


def on_an_instance(scene, image):
    on_an_object(scene, image)
    rig = bpy.data.collections.new("Rig")
    plane = scene.objects["Plane"]
    rig.objects.link(plane)
    scene.collection.objects.unlink(plane)
    empty = add(scene, "Instances", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", rig


def in_the_world(scene, image):
    tree = add_world(scene).id_data
    tree.nodes.new("ShaderNodeTexEnvironment").image = image


@pytest.mark.parametrize("use", [on_an_object, on_an_instance, in_the_world])
def test_no_copy_is_made_without_what_was_painted(scene, image, use):
    use(scene, image)
    with pytest.raises(NoCopyError, match="'Poster' was painted and not saved.* save or pack it"):
        SavedCopy(scene)
    image.pack()
    SavedCopy(scene).remove()


def on_nothing(_scene, image):
    material_of(image).use_fake_user = True


def hidden(scene, image):
    on_an_instance(scene, image)
    bpy.data.objects["Plane"].hide_render = True


def in_another_scene(scene, image):
    on_an_object(bpy.data.scenes.new("Other"), image)


def to_work_by(scene, image):
    scene.camera.data.background_images.new().image = image
    empty = add(scene, "Reference", None)
    empty.empty_display_type, empty.data = "IMAGE", image
    scene.tool_settings.image_paint.canvas = image


@pytest.mark.parametrize("use", [on_nothing, hidden, in_another_scene, to_work_by])
def test_what_no_render_shows_may_be_painted(scene, image, use):
    use(scene, image)
    assert unsaved_images.names(scene) == []


def test_it_is_said_where_work_begins(lit, image):
    lit.objects["Plane"].data.materials.append(material_of(image))
    frame = verify.ImageFrame(None)
    with pytest.raises(NoCopyError, match="Poster"):
        verify.Verification(lit, frame, "Camera", 8, {})
    with pytest.raises(RuntimeError, match="image 'Poster' was painted and not saved"):
        bpy.ops.relume.background_start()
    assert background.all_jobs() == []


def test_several_are_named(scene, image):
    add_quad(scene, material=material_of(image))
    other = bpy.data.images.new("Floor", 8, 8)
    other.pixels[0] = 1.0
    add_quad(scene, material=material_of(other))
    assert unsaved_images.refusal(scene).startswith("images 'Floor', 'Poster' were painted")
