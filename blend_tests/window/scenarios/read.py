"""A shot is read whatever its own render would show, in views of all kinds, and all settings stay."""

import time

import bpy
from artist import Artist, addon

NEEDS = ["demo.blend"]
LATE = "a render that begins late"
LATE_SECONDS = 0.3
CASES = [
    ("CYCLES", "//pictures/", 1, "an engine that no view sees"),
    ("RELUME", "//pictures/", 1, "the engine itself"),
    ("BLENDER_WORKBENCH", "//pictures/", 1, "an engine of Blender's"),
    ("CYCLES", "//CYCLES", 1, "a name in two places"),
    ("CYCLES", "//RELUME", 1, "the other name in two places"),
    ("CYCLES", "//pictures/", 1, LATE),
    ("CYCLES", "//pictures/", 2, "a layer that has to be named"),
]
"""Engine, path of output, view layers, and what is special about it."""


def show_other_things(scene):
    """A compositor and a sequence in which the scene is not to be seen."""
    tree = bpy.data.node_groups.new("Grey", "CompositorNodeTree")
    tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
    tree.links.new(tree.nodes.new("CompositorNodeRGB").outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    scene.compositing_node_group = tree
    scene.sequence_editor_create().strips.new_effect("Grey", "COLOR", channel=1, frame_start=1, length=100)


def come_late(*_arguments):
    """Delays a render on its thread before its settings are copied, as another add-on may."""
    time.sleep(LATE_SECONDS)


def settings_of(scene):
    """Settings that are switched while a scene is read."""
    render = scene.render
    return render.engine, render.filepath, render.use_sequencer, render.use_compositing, len(scene.view_layers)


def play(driver):
    """See the first line of this file."""
    artist = Artist(driver)
    with driver.step("open"):
        yield from artist.open("demo.blend", (160, 90), samples=1, train_seconds=0)
        yield from artist.start()
        yield from artist.until_settled()
    scene = artist.scene
    lit = artist.picture().mean()
    show_other_things(scene)
    space = next(area.spaces.active for area in driver.window.screen.areas if area.type == "VIEW_3D")
    for number, (engine, path, layers, words) in enumerate(CASES):
        with driver.step(words):
            scene.render.engine, scene.render.filepath = engine, path
            while len(scene.view_layers) < layers:
                scene.view_layers.new("More")
            space.shading.type = ("SOLID", "MATERIAL", "RENDERED")[number % 3]
            yield from driver.drawn()
            before = settings_of(scene)
            if words == LATE:
                bpy.app.handlers.render_init.append(come_late)
            yield from artist.rebake()
            if words == LATE:
                bpy.app.handlers.render_init.remove(come_late)
            yield from artist.until_settled()
            driver.check(settings_of(scene) == before, f"the settings are {settings_of(scene)}, and were {before}")
            driver.check(addon("engine.reading.render_depsgraph").MARK not in scene, "nothing is left in the scene")
            mean = artist.picture().mean()
            driver.check(abs(mean - lit) < 0.05 * lit, f"the picture is the scene's: its mean is {mean}, and was {lit}")
            driver.photo(words.replace(" ", "-"))
