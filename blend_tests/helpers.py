"""Small builders and the exported scene as plain data."""

import json
import time

import bpy
import numpy as np
import relume
from mathutils import Matrix

from addon.core.rows import LIGHT
from addon.engine.reading.scene import load_scene
from addon.engine.shot import shot
from addon.export import ExportOptions, trace_settings
from addon.live import rows
from addon.live.scheduler import TICK_SECONDS, scheduler
from addon.ui import background as jobs

SECONDS = 120.0
"""How long pictures are waited for; other tests may keep the machine busy."""


def exported(scene, **options):
    """The summary of the exported scene."""
    return json.loads(load_scene(scene, ExportOptions(**options)).summary())


def add(scene, name, data):
    """A linked object."""
    obj = bpy.data.objects.new(name, data)
    scene.collection.objects.link(obj)
    return obj


def add_quad(scene, name="Plane", size=2.0, material=None):
    """A square in the xy plane, with a UV map."""
    half = size / 2
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    uv = mesh.uv_layers.new(name="UVMap")
    uv.uv.foreach_set("vector", [0, 0, 1, 0, 1, 1, 0, 1])
    if material:
        mesh.materials.append(material)
    return add(scene, name, mesh)


def shear(scene, light):
    """Makes a light a small area that its parent shears. Unlike all others it is not connected: paths must meet it."""
    rig = add(scene, "Rig", None)
    rig.scale = (1.2, 0.8, 1.0)
    light.data.type, light.data.size = "AREA", 0.02
    light.parent, light.rotation_euler.z = rig, 0.6
    bpy.context.view_layer.update()


def add_light(scene, kind, name="Lamp", location=(0, 0, 2), **settings):
    """A light 2 m above the origin, pointing down, of 100 W unless told otherwise."""
    light = bpy.data.lights.new(name, kind)
    light.energy = 100.0
    for key, value in settings.items():
        setattr(light, key, value)
    obj = add(scene, name, light)
    obj.location = location
    return obj


def instance_linked_light(scene, folder, name="Bulb"):
    """A light of another file in an instanced collection; its name in pictures."""
    rig = bpy.data.collections.new("Rig")
    rig.objects.link(bpy.data.objects.new(name, bpy.data.lights.new(name, "POINT")))
    bpy.data.libraries.write(str(folder / "rig.blend"), {rig})
    for obj in list(rig.objects):
        bpy.data.lights.remove(obj.data)
    bpy.data.collections.remove(rig)
    with bpy.data.libraries.load(str(folder / "rig.blend"), link=True) as (_, wanted):
        wanted.collections = ["Rig"]
    empty = add(scene, "Rig", None)
    empty.instance_type, empty.instance_collection = "COLLECTION", wanted.collections[0]
    empty.location.z = 2.0
    wanted.collections[0].objects[0].data.energy = 100.0
    return f"{name} [rig.blend]"


def add_material(name="Material"):
    """A material with an empty tree; returns it, its tree and its output node."""
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 2, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    return material, tree, tree.nodes.new("ShaderNodeOutputMaterial")


def add_world(scene, color=(0.2, 0.3, 0.4), strength=0.5):
    """A world of one Background node; returns the node."""
    world = scene.world = bpy.data.worlds.new("Sky")
    if bpy.app.version < (5, 2, 0):
        world.use_nodes = True
    node = background(scene)
    node.inputs["Color"].default_value, node.inputs["Strength"].default_value = (*color, 1.0), strength
    return node


def background(scene):
    """The node with the colour of the world."""
    return next(node for node in scene.world.node_tree.nodes if node.bl_idname == "ShaderNodeBackground")


def sky_file(folder):
    """An equirectangular picture, red towards +y and blue towards -y."""
    image = bpy.data.images.new("sky", 16, 8)
    image.pixels.foreach_set(([1.0, 0.1, 0.0, 1.0] * 8 + [0.0, 0.1, 1.0, 1.0] * 8) * 8)
    image.filepath_raw, image.file_format = str(folder / "sky.png"), "PNG"
    image.save()
    bpy.data.images.remove(image)
    return folder / "sky.png"


def add_sky(background, file):
    """An environment texture that a Background node shows; returns it and the Mapping node that turns it."""
    tree = background.id_data
    kinds = ("TexEnvironment", "Mapping", "TexCoord")
    texture, mapping, coordinates = (tree.nodes.new(f"ShaderNode{kind}") for kind in kinds)
    texture.image = bpy.data.images.load(str(file))
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs[0], texture.inputs["Vector"])
    tree.links.new(texture.outputs[0], background.inputs["Color"])
    return texture, mapping


def affine(columns):
    """4 x 4 matrix from the 12 numbers of a glam `Affine3A`."""
    matrix = np.eye(4)
    matrix[:3, :] = np.array(columns).reshape(4, 3).T
    return Matrix(matrix.tolist())


def render_cycles(scene, samples=64, channels=3, **settings):
    """Scene-linear pixels of a plain Cycles render, [height, width, channels], bottom row first."""
    cycles = scene.cycles
    cycles.samples, cycles.device = samples, "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.light_sampling_threshold = 0.0
    for key, value in settings.items():
        setattr(cycles, key, value)
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.render.filepath = bpy.app.tempdir + "cycles.exr"
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, -1)[..., :channels]


def both_lit(scene, folder, samples, channels=3):
    """Pictures of a scene by Relume, baked into a folder without a warning, and by Cycles; both from below up."""
    bpy.context.view_layer.update()
    loaded = load_scene(scene)
    assert loaded.warnings == []
    relume.bake(loaded, folder, trace_settings(scene, lambda _: None) | {"samples": samples}).wait()
    picture = relume.Relighter(folder).relight(loaded.lights(), denoise=False)
    ours = np.concatenate([picture["combined"], picture["alpha"]], axis=-1)[::-1, :, :channels]
    return ours, render_cycles(scene, samples, channels=channels)


def write_multilayer(scene, path):
    """Makes final renders write all passes into an EXR, as floats."""
    output = scene.render.image_settings
    if hasattr(output, "media_type"):
        output.media_type = "MULTI_LAYER_IMAGE"
    output.file_format, output.exr_codec, output.color_depth = "OPEN_EXR_MULTILAYER", "NONE", "32"
    scene.render.filepath = str(path)


def ended(job, seconds=120):
    """A background job, polled until it is over, as the window's timer does."""
    deadline = time.monotonic() + seconds
    while job.is_running and time.monotonic() < deadline:
        jobs.tick()
        time.sleep(0.02)
    assert not job.is_running
    return job


def update():
    """Evaluates the scene, as Blender does after every change; this calls the handlers."""
    bpy.context.view_layer.update()


def row(scene, name, kind=LIGHT):
    """The row of a name."""
    return next(row for row in rows.present_rows(scene) if (row.kind, row.name) == (kind, name))


def until(scene, condition, what):
    """Ticks as Blender's timer does, until something is so."""
    deadline = time.monotonic() + SECONDS
    while time.monotonic() < deadline:
        scheduler.tick()
        found = shot.of(scene)
        assert found.status.phase != "failed", found.status.error
        if condition(found):
            return found
        time.sleep(TICK_SECONDS)
    raise AssertionError(f"waited {SECONDS} s for {what}: {found.status}")


def settled(found):
    """True if the newest request has its full picture and nothing goes on."""
    return not found.is_busy and not scheduler.settling and found.frame is not None and found.frame.scale == 1


def said(scene):
    """Changes since the bake, in sentences, after everything was looked at."""
    update()
    found = shot.of(scene)
    for _ in range(1000):
        scheduler.tick()
        scheduler.settling.clear()
        if not found.changes.is_pending:
            return found.changes.sentences
    raise AssertionError("looking for changes does not come to an end")


def compositor(scene):
    """The tree of a scene's compositor."""
    if bpy.app.version < (5, 0, 0):
        scene.use_nodes = True
        return scene.node_tree
    scene.compositing_node_group = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    return scene.compositing_node_group
