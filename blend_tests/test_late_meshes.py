"""Meshes that another Blender finishes, so that the window does not wait for them."""

import time

import bpy
import numpy as np
import pytest
import relume

from addon.core import array_file
from addon.engine.reading.render_depsgraph import ExportCancelled, with_render_depsgraph
from addon.engine.workers import helper
from addon.engine.workers.mesh_worker import finishing
from addon.export import ExportOptions, export_scene, late_mesh
from addon.export.geometry import mesh_arrays
from helpers import add, add_material

FACES = late_mesh.SUBDIVIDED_FACES
SECONDS = 60.0
pytestmark = [
    pytest.mark.every_version,
    pytest.mark.skipif(bpy.app.version < (4, 5, 0), reason="this Blender tells of no mesh before it is finished"),
]


@pytest.fixture(autouse=True)
def any_size(monkeypatch):
    """No mesh is too small, and no other Blender outlives a test."""
    monkeypatch.setattr(late_mesh, "SUBDIVIDED_FACES", 1)
    monkeypatch.setattr(late_mesh, "SHADED_FACES", 1)
    yield
    helper.close()


def add_rock(scene, name="Rock", seed=1):
    """A bent object with creases, sharp edges, colours, UV maps, materials and an attribute, subdivided last."""
    rng = np.random.default_rng(seed)
    bpy.ops.mesh.primitive_monkey_add()
    obj = bpy.context.object
    obj.name = obj.data.name = name
    mesh = obj.data
    mesh.shade_smooth()
    for material in ("First", "Second"):
        mesh.materials.append(add_material(material)[0])
    painted = mesh.color_attributes.new("Painted", "BYTE_COLOR", "CORNER")
    painted.data.foreach_set("color", rng.random(4 * len(mesh.loops), np.float32))
    tinted = mesh.color_attributes.new("Tinted", "FLOAT_COLOR", "POINT")
    tinted.data.foreach_set("color", rng.random(4 * len(mesh.vertices), np.float32))
    mesh.color_attributes.render_color_index = mesh.color_attributes.find("Tinted")
    mesh.uv_layers.new(name="Other").active_render = True
    values = {
        "crease_edge": ("FLOAT", "EDGE", rng.random(len(mesh.edges), np.float32)),
        "sharp_edge": ("BOOLEAN", "EDGE", rng.random(len(mesh.edges)) > 0.9),
        "material_index": ("INT", "FACE", rng.integers(0, 2, len(mesh.polygons), np.int32)),
        "Height": ("FLOAT", "POINT", rng.random(len(mesh.vertices), np.float32)),
    }
    for attribute, (kind, domain, array) in values.items():
        mesh.attributes.new(attribute, kind, domain).data.foreach_set("value", array)
    obj.modifiers.new("Bend", "SIMPLE_DEFORM").angle = 0.5
    obj.modifiers.new("Subdivision", "SUBSURF").render_levels = 2
    return obj


def subdivision(rock, **settings):
    """Sets up the last modifier of a rock."""
    for name, value in settings.items():
        setattr(rock.modifiers[-1], name, value)


def simplify(rock):
    """Has renders subdivide it once at most."""
    render = bpy.context.scene.render
    render.use_simplify, render.simplify_subdivision_render = True, 1


def with_custom_normals(rock):
    """Gives it normals that the subdivision interpolates."""
    rock.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(rock.data.loops))
    subdivision(rock, use_custom_normals=True)


def with_nothing_after(rock):
    """Leaves a mesh that is changed and not subdivided."""
    rock.modifiers.remove(rock.modifiers[-1])


def with_shape_keys(rock):
    """Leaves a mesh that only shape keys change."""
    rock.modifiers.clear()
    rock.shape_key_add(name="Basis")
    key = rock.shape_key_add(name="Wide")
    for point in key.data:
        point.co.x *= 2.0
    key.value = 0.5


def with_a_texture_space(rock):
    """Gives it one of its own."""
    rock.data.use_auto_texspace = False
    rock.data.texspace_location, rock.data.texspace_size = (1, 2, 3), (4, 5, 6)


def adaptive(rock):
    """The setting that has Cycles subdivide it by its size in the picture, which a file of 4.5 has for the object."""
    return {"use_adaptive_subdivision": True} if hasattr(rock.modifiers[-1], "use_adaptive_subdivision") else {}


CASES = {
    "creased": lambda rock: None,
    "simple": lambda rock: subdivision(rock, subdivision_type="SIMPLE", uv_smooth="SMOOTH_ALL"),
    "no limit surface": lambda rock: subdivision(
        rock, use_limit_surface=False, quality=1, boundary_smooth="PRESERVE_CORNERS"
    ),
    "simplified": simplify,
    "adaptive": lambda rock: subdivision(rock, **adaptive(rock)),
    "custom normals": with_custom_normals,
    "not subdivided": with_nothing_after,
    "shape keys": with_shape_keys,
    "texture space": with_a_texture_space,
    "off after it": lambda rock: setattr(rock.modifiers.new("Off", "SUBSURF"), "render_levels", 0),
}


@pytest.mark.parametrize("case", CASES)
def test_another_blender_finishes_a_mesh_as_this_one_does(scene, tmp_path, case):
    rock = add_rock(scene)
    CASES[case](rock)

    def read(depsgraph, _stop):
        evaluated = rock.evaluated_get(depsgraph)
        late = late_mesh.late_mesh(evaluated, scene.render)
        array_file.write(tmp_path / "late", late.plain)
        return mesh_arrays(evaluated.data, ["Height"])

    here = with_render_depsgraph(scene, read)
    with finishing(lambda: False) as finish:
        there = finish(late_mesh.LateMesh(array_file.read(tmp_path / "late"), None), ["Height"])()
    same(here, there)
    assert len(here["face_starts"]) == {"not subdivided": 500, "shape keys": 500, "simplified": 1968}.get(case, 7872)


def same(here, there):
    """Whether two trees of arrays are equal to the last bit, in the same order."""
    if isinstance(here, dict):
        assert list(here) == list(there)
        for name, value in here.items():
            same(value, there[name])
    else:
        assert np.array_equal(here, there)


def scene_read(scene, finish=None):
    """The scene; without `finish` read by this Blender alone."""

    def read(depsgraph, _stop):
        builder = relume.SceneBuilder()
        export_scene(builder, depsgraph, ExportOptions(), finish_mesh=finish)
        return builder.build()

    return with_render_depsgraph(scene, read)


def read_with_another(scene, asked, stop=lambda: False):
    """The scene, read with the other Blender; appends the names of meshes that this one was asked for."""
    with finishing(stop) as finish:

        def begin(late, names):
            asked.append(late.plain["name"])
            return finish(late, names)

        return scene_read(scene, begin)


@pytest.fixture
def rocks(scene):
    """Two rocks, one of them twice, a plain instance of both, and text."""
    first, second = add_rock(scene, "First"), add_rock(scene, "Second", seed=2)
    twin = add(scene, "Twin", first.data)
    twin.location.x = 3.0
    group = bpy.data.collections.new("Group")
    for obj in (first, second):
        group.objects.link(obj)
    empty = add(scene, "Instance", None)
    empty.instance_type, empty.instance_collection, empty.location.z = "COLLECTION", group, 4.0
    text = bpy.data.curves.new("Text", "FONT")
    text.body = "Relume"
    add(scene, "Text", text)
    return scene


def test_a_scene_is_the_same_with_another_blenders_meshes(rocks):
    asked = []
    assert read_with_another(rocks, asked).hash == scene_read(rocks).hash
    assert sorted(asked) == ["First", "Second"]
    until = time.monotonic() + SECONDS
    while list(helper.shared()._place.iterdir()):
        assert time.monotonic() < until
        time.sleep(0.01)
    assert read_with_another(rocks, []).hash == scene_read(rocks).hash, "the next time, by the same one"


def test_where_the_other_blender_fails_this_one_finishes_meshes(rocks, monkeypatch):
    monkeypatch.setattr(helper, "blender_command", lambda *_: ["false"])
    asked = []
    assert read_with_another(rocks, asked).hash == scene_read(rocks).hash
    assert len(asked) == 2


def test_a_full_disk_leaves_meshes_to_this_blender(rocks, monkeypatch):
    def full(*_):
        raise OSError("no space left")

    monkeypatch.setattr(array_file, "write", full)
    assert read_with_another(rocks, []).hash == scene_read(rocks).hash


def test_cancel_does_not_wait_for_the_other_blender(rocks, monkeypatch):
    monkeypatch.setattr(helper, "blender_command", lambda *_: ["sleep", "600"])
    until = time.monotonic() + 0.2
    with pytest.raises(ExportCancelled):
        read_with_another(rocks, [], lambda: time.monotonic() > until)
    assert time.monotonic() < until + 30.0
    assert not helper.shared().is_running and not list(helper.shared()._place.iterdir())


def test_small_meshes_are_not_late(rocks, monkeypatch):
    monkeypatch.setattr(late_mesh, "SUBDIVIDED_FACES", 7873)
    monkeypatch.setattr(late_mesh, "SHADED_FACES", 501)
    monkeypatch.setattr(late_mesh, "IRREGULAR_FACES", 0)
    asked = []
    read_with_another(rocks, asked)
    assert asked == []


def creased(obj):
    """Gives every edge a crease."""
    crease = obj.data.attributes.new("crease_edge", "FLOAT", "EDGE")
    crease.data.foreach_set("value", [0.5] * len(obj.data.edges))


def without_limit(obj):
    """Leaves its points where repeated subdivision has them."""
    obj.modifiers[-1].use_limit_surface = False


def emptied(obj):
    """Leaves nothing of it."""
    obj.data.clear_geometry()


def of_best_quality(obj):
    """Isolates its points more often."""
    obj.modifiers[-1].quality = 10


SHAPES = {
    "of quads": ("grid", {"x_subdivisions": 20, "y_subdivisions": 20}, None, False),
    "of quads, creased": ("grid", {"x_subdivisions": 20, "y_subdivisions": 20}, creased, True),
    "of triangles": ("ico_sphere", {"subdivisions": 3}, None, True),
    "of triangles, without a limit": ("ico_sphere", {"subdivisions": 3}, without_limit, False),
    "few triangles": ("ico_sphere", {"subdivisions": 1}, None, False),
    "few triangles of best quality": ("ico_sphere", {"subdivisions": 1}, of_best_quality, True),
    "nothing": ("grid", {}, emptied, False),
    "large polygons": ("cylinder", {"vertices": 64}, None, True),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_what_makes_a_limit_surface_slow_is_its_irregular_points(scene, monkeypatch, shape):
    kind, settings, change, is_late = SHAPES[shape]
    monkeypatch.setattr(late_mesh, "SUBDIVIDED_FACES", FACES)
    getattr(bpy.ops.mesh, f"primitive_{kind}_add")(**settings)
    obj = bpy.context.object
    obj.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    if change is not None:
        change(obj)
    found = with_render_depsgraph(
        scene, lambda depsgraph, _stop: late_mesh.late_mesh(obj.evaluated_get(depsgraph), scene.render)
    )
    assert (found is not None) == is_late
