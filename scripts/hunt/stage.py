"""Scenes to put random things into, and the two pictures of each. Needs `bpy` and `relume`."""

import math
import sys
import tempfile
from pathlib import Path

import bpy
import relume

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts/parity")]

import cycles_reference  # noqa: E402
from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.export import trace_settings  # noqa: E402


def empty_scene(width, height):
    """A new file: Cycles without tricks, box filter, a black world, three images, no camera yet."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    cycles_reference.prepare(scene, width, height)
    scene.cycles.pixel_filter_type = "BOX"
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("World")
    use_nodes(scene.world)
    background(scene).inputs["Color"].default_value = (0, 0, 0, 1)
    _add_images()
    return scene


def use_nodes(block):
    """Gives a material, world or light a node tree; from Blender 5.2 on it has one."""
    if bpy.app.version < (5, 2, 0) or block.node_tree is None:
        block.use_nodes = True
    return block.node_tree


def background(scene):
    """The Background node of the world."""
    return next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")


def _add_images():
    grid = bpy.data.images.new("grid", 32, 32)
    grid.generated_type = "COLOR_GRID"
    ramp = bpy.data.images.new("ramp", 8, 8, alpha=True, float_buffer=True)
    ramp.pixels.foreach_set([(i * 7 % 11) / 8 for i in range(8 * 8 * 4)])
    ramp.pack()
    data = bpy.data.images.new("data", 8, 8, alpha=True)
    data.pixels.foreach_set([(i * 5 % 13) / 12 for i in range(8 * 8 * 4)])
    data.update()
    data.colorspace_settings.name = "Non-Color"
    data.pack()


def add(scene, name, data):
    """A linked object."""
    obj = bpy.data.objects.new(name, data)
    scene.collection.objects.link(obj)
    return obj


def add_camera(scene, location, rotation, ortho_scale=None):
    """The camera; orthographic of a width in metres, or of 50 mm."""
    camera = scene.camera = add(scene, "Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = location, rotation
    if ortho_scale:
        camera.data.type, camera.data.ortho_scale = "ORTHO", ortho_scale


def new_material(name):
    """A material whose tree holds an output alone; returns it, its tree and the output."""
    material = bpy.data.materials.new(name)
    tree = use_nodes(material)
    tree.nodes.clear()
    return material, tree, tree.nodes.new("ShaderNodeOutputMaterial")


def plain_material(name, kind="ShaderNodeBsdfDiffuse", **inputs):
    """A material of one closure; names of inputs have underscores for spaces."""
    material, tree, output = new_material(name)
    node = tree.nodes.new(kind)
    for key, value in inputs.items():
        node.inputs[key.replace("_", " ")].default_value = value
    tree.links.new(node.outputs[0], output.inputs["Surface"])
    return material


def square(name, size, material, with_uv=True):
    """A mesh of one face in the xy plane."""
    half = size / 2
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    if with_uv:
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    mesh.materials.append(material)
    return mesh


def ball(name, radius, material, smooth=True, rings=16):
    """A UV sphere."""
    mesh = bpy.data.meshes.new(name)
    columns = 2 * rings
    points = [(0.0, 0.0, -radius)]
    for ring in range(1, rings):
        polar = math.pi * ring / rings
        for column in range(columns):
            turn = 2 * math.pi * column / columns
            side = radius * math.sin(polar)
            points.append((side * math.cos(turn), side * math.sin(turn), -radius * math.cos(polar)))
    points.append((0.0, 0.0, radius))

    def at(ring, column):
        return 1 + (ring - 1) * columns + column % columns

    faces = [(0, at(1, c + 1), at(1, c)) for c in range(columns)]
    faces += [
        (at(r, c), at(r, c + 1), at(r + 1, c + 1), at(r + 1, c)) for r in range(1, rings - 1) for c in range(columns)
    ]
    faces += [(at(rings - 1, c), at(rings - 1, c + 1), len(points) - 1) for c in range(columns)]
    mesh.from_pydata(points, [], faces)
    uv = mesh.uv_layers.new(name="UVMap").uv
    where = [points[loop.vertex_index] for loop in mesh.loops]
    turns = [math.atan2(y, x) / (2 * math.pi) + 0.5 for x, y, _ in where]
    uv.foreach_set("vector", [v for turn, (_, _, z) in zip(turns, where, strict=True) for v in (turn, z / radius)])
    mesh.polygons.foreach_set("use_smooth", [smooth] * len(mesh.polygons))
    mesh.materials.append(material)
    return mesh


def box(name, size, material):
    """A cube with a UV map that every face fills."""
    half = size / 2
    points = [(x, y, z) for z in (-half, half) for y in (-half, half) for x in (-half, half)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1] * 6)
    mesh.materials.append(material)
    return mesh


def random_attributes(rng, mesh):
    """Attributes of the names that random trees ask for (`trees.NAMES`), on random domains."""
    kind, domain = rng.choice(["FLOAT_COLOR", "BYTE_COLOR"]), rng.choice(["POINT", "CORNER"])
    color = mesh.color_attributes.new("Col", kind, domain)
    color.data.foreach_set("color", [rng.random() for _ in range(4 * len(color.data))])
    number = mesh.attributes.new("f", "FLOAT", rng.choice(["POINT", "FACE", "CORNER"]))
    number.data.foreach_set("value", [rng.random() for _ in range(len(number.data))])
    vector = mesh.attributes.new("vec", "FLOAT_VECTOR", rng.choice(["POINT", "FACE", "CORNER"]))
    vector.data.foreach_set("vector", [rng.random() for _ in range(3 * len(vector.data))])
    if rng.random() < 0.7:
        second = mesh.uv_layers.new(name="Second").uv
        second.foreach_set("vector", [rng.random() for _ in range(2 * len(second))])


def export(scene):
    """The native scene, its settings, and all that was said."""
    bpy.context.view_layer.update()
    exported, said = load_scene(scene), []
    settings = trace_settings(scene, said.append)
    return exported, settings, [*exported.warnings, *said]


def relit(exported, settings, samples):
    """Two independent pictures of the scene's own lights, and what was said while baking."""
    pictures, said = [], []
    for seed in (0, 1):
        with tempfile.TemporaryDirectory(prefix="relume-hunt-") as folder:
            relume.bake(exported, folder, settings | {"samples": samples, "seed": seed}).wait(on_warning=said.append)
            pictures.append(relume.Relighter(folder).relight(denoise=False)["combined"])
    return pictures, said


def rendered(scene, samples, first_seed):
    """Two independent pictures by Cycles, not denoised."""
    scene.cycles.use_denoising = False
    for layer in scene.view_layers:
        layer.samples = 0
    return [cycles_reference.render(scene, samples, first_seed + half) for half in (0, 1)]
