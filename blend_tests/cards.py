"""Materials side by side on cards, as Relume and as Cycles see them: a picture of each compares many graphs at once."""

import math

import bpy
import numpy as np
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add_light, add_material, add_quad, render_cycles

PIXELS = 8
"""Pixels along a card's side."""


class Cards:
    """A scene whose cards are seen from above, each as a square of pixels."""

    def __init__(self, scene, columns=8):
        self.scene, self.columns = scene, columns
        self.names = []

    def add(self, name):
        """A card one metre wide with a material of its own; returns its tree and its output node."""
        material, tree, output = add_material(name)
        card = add_quad(self.scene, name, size=1.0, material=material)
        card.location = (len(self.names) % self.columns + 0.5, len(self.names) // self.columns + 0.5, 0.0)
        self.names.append(name)
        return tree, output

    def add_lit(self, name):
        """A white card with an area lamp close above; returns the lamp."""
        tree, output = self.add(name)
        diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
        diffuse.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
        tree.links.new(diffuse.outputs[0], output.inputs["Surface"])
        place = self.scene.objects[name].location
        lamp = add_light(self.scene, "AREA", name, (place.x, place.y, 0.02), size=0.98, energy=math.pi)
        if bpy.app.version < (5, 2, 0):
            lamp.data.use_nodes = True
        return lamp.data

    def show(self, tree, output, socket):
        """Shows a socket: a shader as it is, anything else as what the card emits."""
        if socket.type != "SHADER":
            emission = tree.nodes.new("ShaderNodeEmission")
            tree.links.new(socket, emission.inputs["Color"])
            socket = emission.outputs[0]
        tree.links.new(socket, output.inputs["Surface"])

    def means(self, tmp_path, samples=16):
        """Mean colours of each card by its name, in Relume's and in Cycles' picture under the scene's lights; and
        Relume's warnings."""
        pixels, warnings = self.pixels(tmp_path, samples)
        return {name: [image.mean(axis=(0, 1)) for image in pair] for name, pair in pixels.items()}, warnings

    def pixels(self, tmp_path, samples=16):
        """The pixels of each card, likewise."""
        self._look()
        scene = load_scene(self.scene)
        folder = tmp_path / "bake"
        relume.bake(scene, folder, trace_settings(self.scene, lambda _: None) | {"samples": samples}).wait()
        ours = relume.Relighter(folder).relight(scene.lights(), denoise=False)["combined"][::-1]
        cycles = render_cycles(self.scene, samples=samples)
        return {name: (self._of(ours, i), self._of(cycles, i)) for i, name in enumerate(self.names)}, scene.warnings

    def _look(self):
        rows = -(-len(self.names) // self.columns)
        camera, render = self.scene.camera, self.scene.render
        camera.data.type, camera.data.ortho_scale = "ORTHO", max(rows, self.columns)
        camera.location, camera.rotation_euler = (self.columns / 2, rows / 2, 5.0), (0.0, 0.0, 0.0)
        render.resolution_x, render.resolution_y = self.columns * PIXELS, rows * PIXELS
        self.scene.world = self.scene.world or bpy.data.worlds.new("Black")
        self.scene.world.color = (0.0, 0.0, 0.0)
        bpy.context.view_layer.update()

    def _of(self, image, number):
        """Without the pixels that see a neighbour."""
        x, y = number % self.columns * PIXELS, number // self.columns * PIXELS
        return image[y + 2 : y + PIXELS - 2, x + 2 : x + PIXELS - 2]


def differences(means, tolerance=0.02):
    """Names of the cards that differ, with both colours."""
    return {
        name: (ours.round(3).tolist(), cycles.round(3).tolist())
        for name, (ours, cycles) in means.items()
        if not np.abs(ours - cycles).max() <= tolerance * (0.05 + np.abs(cycles).max())
    }


def differing_pixels(cards, tmp_path, tolerance=0.02):
    """Cards with pixels that differ, and how much; and Relume's warnings."""
    pixels, warnings = cards.pixels(tmp_path, samples=128)
    found = {name: float(np.abs(ours - cycles).max()) for name, (ours, cycles) in pixels.items()}
    return {name: difference for name, difference in found.items() if not difference <= tolerance}, warnings


def node(tree, kind, inputs=None, mute=False, **settings):
    """A node; an input is a socket to be linked or a value."""
    made = tree.nodes.new(kind)
    for name, value in settings.items():
        setattr(made, name, value)
    for key, value in (inputs or {}).items():
        socket = next((socket for socket in made.inputs if socket.identifier == key), None) or made.inputs[key]
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, socket)
        else:
            socket.default_value = value
    made.mute = mute
    return made
