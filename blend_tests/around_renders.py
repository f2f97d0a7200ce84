"""Reads and renders a small scene with each of the things that Blender does around a render, in a Blender of its own:
python around_renders.py FOLDER. Prints a line of JSON for each: what of the scene's settings and files is different
afterwards, the hash of what was read, and what was reported."""

import json
import os
import sys
from pathlib import Path

import bpy

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.engine.render import render_engine  # noqa: E402
from helpers import add, add_light, add_quad, compositor  # noqa: E402

BEFORE_5 = bpy.app.version < (5, 0, 0)
HANDLERS = ("render_init", "render_pre", "render_post", "render_complete", "render_cancel", "render_write")


def plain(_scene, _folder):
    """Nothing."""


def freestyle(scene, _folder):
    """Lines, in the picture and as a pass of their own."""
    scene.render.use_freestyle = True
    scene.view_layers[0].freestyle_settings.linesets.new("Lines")
    scene.view_layers.new("Foreground").freestyle_settings.as_render_pass = True


def freestyle_of_no_layer(scene, _folder):
    """Switched on for the scene alone."""
    scene.render.use_freestyle = True
    scene.view_layers[0].use_freestyle = False


def file_output(scene, folder):
    """A compositor that writes files."""
    tree = compositor(scene)
    layers, output = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("CompositorNodeOutputFile")
    if BEFORE_5:
        output.base_path = str(folder)
    else:
        output.directory = str(folder)
        output.file_output_items.new("RGBA", "Image")
    tree.links.new(layers.outputs[0], output.inputs[0])


def in_another_compositor(scene, folder):
    """Also used by the compositor of another scene."""
    other = bpy.data.scenes.new("Edit")
    file_output(other, folder)
    trees = other.node_tree if BEFORE_5 else other.compositing_node_group
    next(node for node in trees.nodes if node.bl_idname == "CompositorNodeRLayers").scene = scene


def sequencer(scene, _folder):
    """A strip of another scene."""
    editor = scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences
    strips.new_scene("Other", bpy.data.scenes.new("Other"), 1, 1)


def stamp(scene, _folder):
    """Words burnt into the picture."""
    scene.render.use_stamp = True


def persistent_data(scene, _folder):
    """Blender keeps the scene of the last render."""
    scene.render.use_persistent_data = True
    load_scene(scene)


def region(scene, _folder):
    """A part of the picture."""
    scene.render.use_border, scene.render.border_min_x = True, 0.5


def cropped_region(scene, folder):
    """And only that."""
    region(scene, folder)
    scene.render.use_crop_to_border = True


def workbench(scene, _folder):
    """Another engine's scene."""
    scene.render.engine = "BLENDER_WORKBENCH"


def single_layer(scene, _folder):
    """Only the layer of the window, which is not the first one."""
    scene.view_layers[0].material_override = bpy.data.materials.new("Clay")
    bpy.context.window.view_layer = scene.view_layers.new("Other")
    scene.render.use_single_layer = True


def handlers_raise(_scene, _folder):
    """Other add-ons that fail at each step."""

    def fail(*_arguments):
        raise RuntimeError("another add-on failed")

    for name in HANDLERS:
        getattr(bpy.app.handlers, name).append(fail)


def handlers_write(_scene, folder):
    """Other add-ons that save the picture when it is done."""

    def save(*_arguments):
        bpy.data.images["Render Result"].save_render(str(folder / "saved.png"))

    bpy.app.handlers.render_complete.append(save)
    bpy.app.handlers.render_post.append(save)


def handlers_hide(scene, _folder):
    """Another add-on that hides an object for renders only."""
    stand_in = add_quad(scene, "Stand-in", 3.0)

    def hide(*_arguments):
        stand_in.hide_render = not stand_in.hide_render

    bpy.app.handlers.render_pre.append(hide)
    bpy.app.handlers.render_post.append(hide)


AROUND = (
    plain,
    freestyle,
    freestyle_of_no_layer,
    file_output,
    in_another_compositor,
    sequencer,
    stamp,
    persistent_data,
    region,
    cropped_region,
    workbench,
    single_layer,
    handlers_raise,
    handlers_write,
    handlers_hide,
)


def main():
    """See the first line of this file."""
    folder = Path(sys.argv[1])
    bpy.ops.preferences.addon_enable(module="cycles")
    for set_up in AROUND:
        tell({"case": set_up.__name__, **read(set_up, folder / set_up.__name__)})
    tell({"case": "disabled", **render_while_disabled(folder / "disabled")})


def read(set_up, folder):
    """Changes that reading a scene leaves behind."""
    scene = new_scene(folder)
    set_up(scene, folder)
    before = state(scene)
    found = load_scene(scene)
    changed = [name for name, value in state(scene).items() if before[name] != value]
    return {"hash": found.hash, "changed": changed, **left(folder)}


def render_while_disabled(folder):
    """Remains of a final render with lines when the add-on goes away meanwhile."""
    import addon

    addon.register()
    scene = new_scene(folder)
    freestyle(scene, folder)
    scene.render.engine, scene.render.filepath = "RELUME", str(folder / "picture")
    render_engine.stop_all()
    try:
        bpy.ops.render.render(write_still=True)
        error = ""
    except RuntimeError as words:
        error = str(words)
    return {"error": error, **left(folder)}


def new_scene(folder):
    """A lit plane under a camera."""
    folder.mkdir()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name in HANDLERS:
        getattr(bpy.app.handlers, name).clear()
    scene = bpy.context.scene
    scene.render.engine, scene.render.filepath = "CYCLES", str(folder / "picture")
    scene.render.resolution_x, scene.render.resolution_y = 16, 12
    scene.camera = add(scene, "Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location.z = 5.0
    add_quad(scene)
    add_light(scene, "POINT", shadow_soft_size=0.2)
    return scene


def state(scene):
    """All of a scene's render settings, its own properties, its compositor's links and what renders show."""
    props = (prop.identifier for prop in scene.render.bl_rna.properties if prop.type not in {"POINTER", "COLLECTION"})
    tree = scene.node_tree if BEFORE_5 else scene.compositing_node_group
    return {name: repr(getattr(scene.render, name)) for name in props} | {
        "own": sorted({*scene.keys()} - {"cycles"}),
        "links": [(link.from_socket.name, link.to_socket.name, link.is_valid) for link in tree.links] if tree else [],
        "hidden": [obj.name for obj in scene.objects if obj.hide_render],
    }


def left(folder):
    """Files that were written."""
    return {"files": sorted(path.name for path in folder.iterdir())}


def tell(line):
    """Prints a line of JSON."""
    print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
    os._exit(0)  # Blender's own exit may crash.
