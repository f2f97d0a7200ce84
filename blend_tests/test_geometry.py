"""Meshes, instances and what they carry."""

import time

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Vector

from addon.export.arrays import stored
from addon.export.geometry import mesh_arrays
from helpers import add, add_material, add_quad, affine, exported
from instances import instancing, unlinked

pytestmark = pytest.mark.every_version


def names(summary):
    return sorted(instance["name"] for instance in summary["instances"])


def add_ball(scene, name="Ball"):
    """A smooth ball of 512 faces, with a UV map."""
    bm = bmesh.new()
    bm.loops.layers.uv.new("UVMap")
    bmesh.ops.create_uvsphere(bm, u_segments=32, v_segments=16, radius=1.0, calc_uvs=True)
    mesh = bpy.data.meshes.new(name)
    bm.to_mesh(mesh)
    bm.free()
    mesh.shade_smooth()
    return add(scene, name, mesh)


def copied(collection, field, width, of=np.float32):
    """Values as Blender's own copying gives them."""
    values = np.empty(len(collection) * width, of)
    collection.foreach_get(field, values)
    return values


def test_render_settings_count_not_viewport_ones(scene):
    cube = add_quad(scene, "Shown")
    modifier = cube.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels, modifier.render_levels = 1, 3
    only_render = add_quad(scene, "RenderOnly")
    only_render.hide_viewport = True
    only_viewport = add_quad(scene, "ViewportOnly")
    only_viewport.hide_render = True
    out = exported(scene)
    assert names(out) == ["RenderOnly", "Shown"]
    assert sorted(mesh["triangles"] for mesh in out["meshes"]) == [2, 2 * 4**3]


def test_linked_duplicates_share_their_mesh(scene):
    first = add_quad(scene, "First")
    second = add(scene, "Second", first.data)
    second.location, second.scale = (1, 2, 3), (-1, 2, 1)
    out = exported(scene)
    assert len(out["meshes"]) == 1 and len(out["instances"]) == 2
    placed = next(instance for instance in out["instances"] if instance["name"] == "Second")
    assert affine(placed["world_from_object"]) == second.matrix_world


def test_collection_instances_are_exported_once(scene):
    hidden = bpy.data.collections.new("Library")
    mesh = add_quad(scene, "Part").data
    bpy.data.objects.remove(bpy.data.objects["Part"])
    hidden.objects.link(bpy.data.objects.new("Part", mesh))
    for index in range(5):
        empty = add(scene, f"Instance{index}", None)
        empty.instance_type, empty.instance_collection = "COLLECTION", hidden
        empty.location = (index, 0, 0)
    out = exported(scene)
    assert len(out["meshes"]) == 1 and len(out["instances"]) == 5
    places = sorted(affine(instance["world_from_object"]).translation.x for instance in out["instances"])
    assert places == [0, 1, 2, 3, 4]
    assert len({instance["random"] for instance in out["instances"]}) == 5
    assert len({instance["receiver"] for instance in out["instances"]}) == 5


@pytest.mark.parametrize("kind", ["CURVE", "FONT", "META"])
def test_curves_text_and_metaballs_become_meshes(scene, kind):
    if kind == "CURVE":
        data = bpy.data.curves.new("Thing", "CURVE")
        data.dimensions, data.bevel_depth = "3D", 0.1
        spline = data.splines.new("POLY")
        spline.points.add(2)
        for index, point in enumerate(spline.points):
            point.co = (index, 0, 0, 1)
    elif kind == "FONT":
        data = bpy.data.curves.new("Thing", "FONT")
        data.body = "Relume"
    else:
        data = bpy.data.metaballs.new("Thing")
        data.elements.new().radius = 1.0
    add(scene, "Thing", data)
    out = exported(scene)
    assert len(out["instances"]) == 1 and out["instanced_triangles"] > 20


def test_flat_smooth_and_mixed_shading(scene):
    for name, smooth in (("Flat", (False, False)), ("Smooth", (True, True)), ("Mixed", (True, False))):
        mesh = bpy.data.meshes.new(name)
        vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0.5), (0, 1, 0.5), (2, 0, 0.3), (2, 1, 0.3)]
        mesh.from_pydata(vertices, [], [(0, 1, 2, 3), (1, 4, 5, 2)])
        mesh.polygons.foreach_set("use_smooth", smooth)
        add(scene, name, mesh)
    out = exported(scene)
    assert {mesh["name"]: mesh["smooth"] for mesh in out["meshes"]} == {"Flat": False, "Smooth": True, "Mixed": True}


def test_custom_normals_count_on_flat_faces(scene):
    mesh = add_quad(scene).data
    mesh.polygons.foreach_set("use_smooth", [False])
    normal = Vector((0.6, 0.0, 0.8))
    mesh.normals_split_custom_set([normal] * 4)
    arrays = mesh_arrays(mesh)
    assert "sharp_faces" not in arrays
    assert np.allclose(arrays["corner_normals"], normal, atol=1e-3)


def test_a_meshs_memory_is_what_blender_copies_out(scene):
    mesh = add_ball(scene).data
    rng = np.random.default_rng(3)
    painted = mesh.color_attributes.new("Painted", "BYTE_COLOR", "CORNER")
    painted.data.foreach_set("color", rng.random(4 * len(mesh.loops), np.float32))
    mesh.attributes.new("Height", "FLOAT", "POINT").data.foreach_set(
        "value", rng.random(len(mesh.vertices), np.float32)
    )
    arrays = mesh_arrays(mesh, ["Height"])
    found = {
        "positions": copied(mesh.vertices, "co", 3),
        "corner_verts": copied(mesh.loops, "vertex_index", 1, np.int32),
        "face_starts": copied(mesh.polygons, "loop_start", 1, np.int32),
        "vertex_normals": copied(mesh.vertex_normals, "vector", 3),
    }
    for name, values in found.items():
        assert np.array_equal(arrays[name].reshape(-1), values), name
    assert np.array_equal(arrays["uv_maps"]["UVMap"].reshape(-1), copied(mesh.uv_layers[0].uv, "vector", 2))
    colors = arrays["color_attributes"]
    assert np.allclose(colors["Painted"].reshape(-1), copied(painted.data, "color", 4), atol=4e-7)
    height = copied(mesh.attributes["Height"].data, "value", 1)[arrays["corner_verts"]]
    assert np.array_equal(colors["Height"], np.stack([height, height, height, np.ones_like(height)], axis=-1))


def test_elements_that_lie_apart_are_no_memory_to_read(scene):
    mesh = add_ball(scene).data
    with pytest.raises(RuntimeError, match="do not lie one after the other"):
        stored(mesh.edges, np.int32)
    assert stored(bpy.data.meshes.new("Empty").vertices, np.float32, 3).shape == (0, 3)


def test_render_uv_map_comes_first(scene):
    mesh = add_quad(scene).data
    second = mesh.uv_layers.new(name="Second")
    second.active_render = True
    colors = mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    colors.data.foreach_set("color", np.ones(16, np.float32))
    out = exported(scene)
    assert out["meshes"][0]["uv_maps"] == ["Second", "UVMap"]
    assert out["meshes"][0]["color_attributes"] == ["Paint"]


def test_slots_and_visibility(scene):
    red, _, _ = add_material("Red")
    plane = add_quad(scene, "Plane", material=red)
    plane.data.materials.append(None)
    plane.visible_camera, plane.visible_glossy = False, False
    plane.pass_index, plane.color = 7, (0.1, 0.2, 0.3, 0.4)
    instance = exported(scene)["instances"][0]
    assert len(instance["materials"]) == 2
    assert instance["visibility"] == [False, True, False, True]
    assert instance["pass_index"] == 7
    assert instance["color"] == pytest.approx([0.1, 0.2, 0.3, 0.4])


def test_an_instance_is_seen_by_rays_that_see_what_instances_it_too(scene):
    plane = add_quad(scene, "Plane")
    scene.collection.objects.unlink(plane)
    empty = instancing(scene, unlinked("Source", plane))
    plane.visible_glossy = empty.visible_diffuse = False
    assert exported(scene)["instances"][0]["visibility"] == [True, False, False, True]
    aside = bpy.data.collections.new("Aside")
    scene.collection.children.link(aside)
    scene.collection.objects.unlink(empty)
    aside.objects.link(empty)
    layer = bpy.context.view_layer.layer_collection.children["Aside"]
    layer.indirect_only = True
    assert exported(scene)["instances"][0]["visibility"] == [False, False, False, True]
    layer.indirect_only, layer.holdout = False, True
    assert exported(scene)["instances"][0]["is_holdout"]


NAN, HUGE = float("nan"), 1e30


def spoil_vertex(obj, value=NAN):
    obj.data.vertices[1].co.z = value


def spoil_all_vertices(obj):
    for vertex in obj.data.vertices:
        vertex.co.z = HUGE


def spoil_uv(obj):
    obj.data.uv_layers[0].uv[0].vector.x = NAN


def spoil_color(obj):
    obj.data.color_attributes.new("Tint", "FLOAT_COLOR", "CORNER").data[0].color[0] = NAN


def spoil_place(obj):
    obj.location.x = NAN


def enlarge(obj):
    obj.scale = (HUGE, HUGE, HUGE)


def flatten(obj):
    obj.scale = (0.0, 0.0, 0.0)


def spoil_index(obj):
    obj.data.loops[2].vertex_index = 9


@pytest.mark.parametrize(
    "spoil, is_left, words",
    [
        (spoil_vertex, True, "1 of its vertices have no finite place or one too far away; faces there are left out"),
        (spoil_all_vertices, False, "4 of its vertices have no finite place"),
        (spoil_uv, True, "1 values of its UV map 'UVMap' are not finite numbers; taken as 0"),
        (spoil_color, True, "1 values of its attribute 'Tint' are not finite numbers; taken as 0"),
        (spoil_place, False, "its transform is not a finite number or too large; left out"),
        (enlarge, False, "its transform is not a finite number or too large; left out"),
        (flatten, False, "scaled to zero; left out"),
        (spoil_index, False, "corner vertex 2 is 9, outside 0..4; run Mesh > Clean Up > Validate in Blender; left out"),
    ],
)
def test_what_is_damaged_is_left_out_and_named(scene, spoil, is_left, words):
    add_quad(scene, "Sound")
    spoil(add_quad(scene, "Broken"))
    found = exported(scene)
    assert names(found) == ["Broken"] * is_left + ["Sound"]
    assert [warning.startswith("object 'Broken': ") and words in warning for warning in found["warnings"]] == [True]


def test_meshes_that_show_nothing_are_no_damage(scene):
    add_quad(scene, "Sound").color = (NAN, 1.0, 1.0, 1.0)
    for name, faces in (("Line", []), ("Needle", [(0, 1, 2)])):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [], faces)
        add(scene, name, mesh)
    found = exported(scene)
    assert names(found) == ["Sound"] and not found["warnings"]


def test_empty_scene_is_refused(scene):
    with pytest.raises(ValueError, match="nothing to render"):
        exported(scene)


def test_a_million_triangles_export_quickly(scene):
    """The limit is generous for slow machines; the printed time is what counts."""
    steps = 708
    axis = np.linspace(0.0, 1.0, steps, dtype=np.float32)
    x, y = np.meshgrid(axis, axis)
    positions = np.stack([x, y, 0.1 * np.sin(20 * x)], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)).reshape(-1)
    quads = np.stack([corner, corner + 1, corner + steps + 1, corner + steps], axis=-1).astype(np.int32)
    mesh = bpy.data.meshes.new("Million")
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.reshape(-1))
    mesh.loops.add(quads.size)
    mesh.loops.foreach_set("vertex_index", quads.reshape(-1))
    mesh.polygons.add(len(quads))
    mesh.polygons.foreach_set("loop_start", np.arange(0, quads.size, 4, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.uv_layers.new(name="UVMap")
    mesh.polygons.foreach_set("use_smooth", np.ones(len(quads), bool))
    add(scene, "Million", mesh)
    bpy.context.view_layer.update()
    start = time.perf_counter()
    out = exported(scene)
    seconds = time.perf_counter() - start
    print(f"export of {out['instanced_triangles']} triangles: {seconds:.2f} s, Blender's evaluation included")
    assert out["instanced_triangles"] == 2 * (steps - 1) ** 2


def test_geometry_nodes_instances_share_their_mesh(scene):
    tree = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    grid, cube = tree.nodes.new("GeometryNodeMeshGrid"), tree.nodes.new("GeometryNodeMeshCube")
    points, output = tree.nodes.new("GeometryNodeInstanceOnPoints"), tree.nodes.new("NodeGroupOutput")
    tree.links.new(grid.outputs["Mesh"], points.inputs["Points"])
    tree.links.new(cube.outputs["Mesh"], points.inputs["Instance"])
    tree.links.new(points.outputs["Instances"], output.inputs[0])
    obj = add_quad(scene, "Scatter")
    obj.modifiers.new("Scatter", "NODES").node_group = tree
    out = exported(scene)
    assert len(out["meshes"]) == 1 and out["meshes"][0]["triangles"] == 12
    assert len(out["instances"]) == 9
    assert len({tuple(instance["world_from_object"]) for instance in out["instances"]}) == 9


def test_particles_are_instances(scene):
    part, emitter = add_quad(scene, "Part", size=0.1), add_quad(scene, "Emitter")
    settings = emitter.modifiers.new("Dust", "PARTICLE_SYSTEM").particle_system.settings
    settings.count, settings.frame_end, settings.physics_type = 20, 1, "NO"
    settings.render_type, settings.instance_object = "OBJECT", part
    scene.frame_set(1)
    out = exported(scene)
    assert len(out["meshes"]) <= 2
    assert sum(instance["name"] == "Part" for instance in out["instances"]) >= 20


def test_the_shadow_terminator_is_read_from_where_it_is_kept(scene):
    plane = add_quad(scene, "Plane")
    owner, shading = plane, "shadow_terminator_shading_offset"
    if not hasattr(plane, shading):
        owner, shading = plane.cycles, "shadow_terminator_offset"
    setattr(owner, shading, 0.5)
    owner.shadow_terminator_geometry_offset = 0.25
    instance = exported(scene)["instances"][0]
    assert (instance["shadow_terminator_offset"], instance["shadow_terminator_shading"]) == (0.25, 0.5)


def test_a_mesh_is_there_while_it_is_edited(scene):
    quad = add_quad(scene)
    quad.modifiers.new("Smooth", "SUBSURF").render_levels = 2
    bpy.context.view_layer.objects.active = quad
    bpy.ops.object.mode_set(mode="EDIT")
    (mesh,) = exported(scene)["meshes"]
    assert mesh["triangles"] == 32 and mesh["uv_maps"] == ["UVMap"]
