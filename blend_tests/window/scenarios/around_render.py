"""Blender's own steps around a render do not reach a shot that is started: Freestyle would crash, a compositor would
write files. Stereo is refused in words. F12 during the reading comes first, then the scene is read again."""

import bpy
from artist import addon, settled

NEEDS = ["demo.blend"]
EVERY_TIME = True
EFFECTS = ("use_freestyle", "use_compositing", "use_sequencer")


def play(driver):
    """See the first lines of this file."""
    yield from driver.open("demo.blend")
    yield from driver.look_through_camera()
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 192, 108, 100
    scene.relume.quality, scene.relume.samples = "CUSTOM", 4
    scene.relume.folder = str(driver.scratch / "bake")
    addon("engine.shot.options").preferences().train_seconds = 0.0
    yield from driver.show_tab("Relume")

    with driver.step("stereo is refused"):
        scene.render.use_multiview = True
        driver.expect_error("Stereo views")
        yield from driver.press_button("relume.start")
        yield from driver.drawn()
        driver.photo("stereo")
        yield from driver.press("ESC")
        driver.check(addon("engine.shot.shot").of(scene) is None, "nothing was started")
        driver.check(any("Stereo views" in line for line in driver.errors_shown()), f"{driver.errors_shown()}")
        scene.render.use_multiview = False

    with driver.step("Freestyle and a compositor with a file output"):
        files = driver.scratch / "files"
        files.mkdir()
        write_files(scene, files)
        scene.render.use_freestyle = True
        scene.view_layers[0].freestyle_settings.linesets.new("Lines")
        before = [getattr(scene.render, name) for name in EFFECTS]
        yield from driver.press_button("relume.start")
        yield from settled(driver)
        driver.photo("started")
        driver.check([getattr(scene.render, name) for name in EFFECTS] == before, "the settings are the artist's")
        driver.check(not list(files.iterdir()), f"no file was written: {list(files.iterdir())}")
        notes = " ".join(addon("engine.shot.shot").of(scene).notes)
        for words in ("Freestyle's lines", "the compositor"):
            driver.check(words in notes, f"{words} are among the notes: {notes}")

    with driver.step("F12 while the scene is read"):
        scene.render.use_compositing = scene.render.use_freestyle = False
        scene.cycles.samples = 1
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=900, y_subdivisions=900, size=0.1, location=(50.0, 50.0, 50.0))
        bpy.ops.relume.rebake()
        shot = addon("engine.shot.shot").of(scene)
        yield from driver.until(lambda: bpy.app.is_job_running("RENDER"), "the reading", 20)
        begun = []
        bpy.app.handlers.render_init.append(lambda scene, *_arguments: begun.append(scene.name))
        bpy.ops.render.render("INVOKE_DEFAULT")
        yield from settled(driver)
        driver.check(begun[0] == scene.name and len(begun) == 2, f"F12 was first, then the reading: {begun}")
        driver.check(addon("engine.shot.shot").of(scene) is shot and shot.is_stored, "the bake was made")
        driver.check(list(bpy.data.scenes) == [scene], "no copy is left")


def write_files(scene, folder):
    """A compositor that brightens the picture and writes it into a folder."""
    tree = bpy.data.node_groups.new("Compositing", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    kinds = ("CompositorNodeRLayers", "CompositorNodeExposure", "CompositorNodeOutputFile", "NodeGroupOutput")
    layers, exposure, files, output = (tree.nodes.new(kind) for kind in kinds)
    files.directory = str(folder)
    files.file_output_items.new("RGBA", "Image")
    tree.links.new(layers.outputs["Image"], exposure.inputs[0])
    for node in (files, output):
        tree.links.new(exposure.outputs[0], node.inputs[0])
    scene.compositing_node_group = tree
