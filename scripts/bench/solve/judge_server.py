"""Cycles as the judge: keeps a file open and takes one JSON request a line on standard input, in a Python with `bpy`.

A request is `{"do": METHOD, ...its arguments}` of `Judge`; the answer is one JSON line. `judge.py` is its client.
"""

import json
import math
import os
import random
import sys
from pathlib import Path

# Blender prints where it likes, from its import on; only answers go to the client.
ANSWERS = os.fdopen(os.dup(1), "w")
os.dup2(2, 1)

import bpy  # noqa: E402
import numpy as np  # noqa: E402
import relume  # noqa: E402
from mathutils import Matrix  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts/parity")]

import cycles_reference  # noqa: E402
from addon.apply import new_lights  # noqa: E402
from addon.apply.look_lights import light_state, restore_lights  # noqa: E402
from addon.core.solve import solved  # noqa: E402
from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.export.lamp_shaders import LampShaders  # noqa: E402
from addon.export.lights import LightExporter, name_of  # noqa: E402
from addon.export.linking import LightLinking  # noqa: E402

HITS = 400
MARGIN = 0.05
"""Share of the edges of the box of what the camera sees that lights stay away from its sides."""
RADII = (0.03, 0.1)
"""Radii of a sphere light, in cube roots of the volume of that box."""


SETTINGS = {"radius", "use_soft_falloff", "shape", "size", "size_y", "spread", "spot_size", "spot_blend", "angle"}


class Judge:
    """The open file."""

    def open(self, blend, size, bare=False):
        """Opens a file at `size` pixels along its longer edge; `bare` takes out its lights, its world and all emission,
        so that what is added is the only light."""
        bpy.ops.wm.open_mainfile(filepath=blend)
        self.scene, self.hidden = bpy.context.scene, []
        render = self.scene.render
        factor = size / max(render.resolution_x, render.resolution_y)
        cycles_reference.prepare(self.scene, round(render.resolution_x * factor), round(render.resolution_y * factor))
        self.scene.cycles.use_denoising = True
        self.scene.cycles.denoiser = "OPENIMAGEDENOISE"
        if bare:
            remove(list(self.lights()))
            switch_off(self.scene.world, *bpy.data.materials)
        return {"width": render.resolution_x, "height": render.resolution_y}

    def lights(self):
        """The light objects."""
        return [obj for obj in self.scene.objects if obj.type == "LIGHT"]

    def space(self):
        """Where lights are drawn: box of what the camera sees, less a margin, and radii that suit it."""
        points = np.array([hit for _, hit in self._hits(random.Random(0), HITS)])
        low, high = np.percentile(points, (2, 98), axis=0)
        low, high = low + MARGIN * (high - low), high - MARGIN * (high - low)
        edge = float(np.prod(high - low) ** (1 / 3))
        return {"min": low.tolist(), "max": high.tolist(), "size": [edge * radius for radius in RADII]}

    def places(self, seed, count, space):
        """Random points of that space in sight of the camera, at least the largest radius before what lies behind."""
        rng, found = random.Random(seed), []
        while len(found) < count:
            origin, hit = self._hits(rng, 1)[0]
            direction = (hit - origin).normalized()
            near, far = entry((origin, direction), space), (hit - origin).length - space["size"][1]
            if near < far:
                point = origin + direction * rng.uniform(near, far)
                if all(a <= value <= b for a, value, b in zip(space["min"], point, space["max"], strict=True)):
                    found.append(list(point))
        return found

    def _hits(self, rng, count):
        """(origin of the camera, where it ends) of random rays of the camera."""
        graph, camera = bpy.context.evaluated_depsgraph_get(), self.scene.camera
        corners = [camera.matrix_world @ corner for corner in camera.data.view_frame(scene=self.scene)]
        top_right, bottom_right, bottom_left, top_left = corners
        origin, found = camera.matrix_world.translation, []
        while len(found) < count:
            across, up = rng.random(), rng.random()
            target = bottom_left + (bottom_right - bottom_left) * across + (top_left - bottom_left) * up
            hit, location, *_ = self.scene.ray_cast(graph, origin, (target - origin).normalized())
            if hit:
                found.append((origin, location))
        return found

    def set(self, lights, only=False):
        """Writes lights, by name, as `relume.solve` describes them for Blender; `only` removes all others."""
        names = {light["name"] for light in lights}
        if only:
            remove([obj for obj in self.lights() if obj.name not in names])
        for light in lights:
            write(self.scene, light)
        bpy.context.view_layer.update()

    def remove(self, names):
        """Removes lights."""
        remove([obj for obj in self.lights() if obj.name in names])

    def apply(self, answer, asked):
        """Writes the answer of `relume.solve` to the lights as *Apply* of the add-on does; `asked` are the lights that
        the request had."""
        present = {name_of(obj): light_state(obj) for obj in self.lights()}
        states = solved(answer, present, self.describe(), asked).states
        made = new_lights.make(self.scene, [state for state in states if state.get("added")])
        restore_lights([*self.lights(), *made], states)
        bpy.context.view_layer.update()

    def change(self, name, gain=1.0, move=(0.0, 0.0, 0.0), tint=(1.0, 1.0, 1.0)):
        """Multiplies a light's energy and colour and moves it, until `put_back`."""
        obj = self.scene.objects[name]
        self.hidden.append((name, obj.data.energy, obj.data.color[:], obj.matrix_world.copy()))
        obj.data.energy *= gain
        obj.data.color = [channel * factor for channel, factor in zip(obj.data.color, tint, strict=True)]
        obj.matrix_world = Matrix.Translation(move) @ obj.matrix_world
        bpy.context.view_layer.update()

    def put_back(self):
        """Undoes every `change`."""
        for name, energy, color, place in reversed(self.hidden):
            obj = self.scene.objects[name]
            obj.data.energy, obj.data.color, obj.matrix_world = energy, color, place
        self.hidden.clear()
        bpy.context.view_layer.update()

    def describe(self):
        """All lights as a request to `relume.solve` has them."""
        found = []
        exporter = LightExporter(
            found.append,
            print_error,
            LightLinking([], print_error),
            LampShaders(relume.SceneBuilder.constant_emission, relume.SceneBuilder, self.scene.frame_current),
        )
        for obj in self.lights():
            exporter.export(obj, obj, obj.matrix_world, self.scene.camera)
        return found

    def light_set(self):
        """All lights in physical units."""
        return json.loads(load_scene(self.scene).lights())

    def render(self, samples, seed, out):
        """Denoised, into a .npy file, [height, width, 3], top row first."""
        np.save(out, cycles_reference.render(self.scene, samples, seed))

    def save(self, path):
        """Writes the file under another name; it stays open."""
        bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)


def entry(ray, space):
    """Distance along a ray to where it enters a box; infinite if it passes it by."""
    origin, direction = ray
    near, far = 0.0, math.inf
    for axis in range(3):
        slope = direction[axis] or 1e-12
        ends = sorted((space[end][axis] - origin[axis]) / slope for end in ("min", "max"))
        near, far = max(near, ends[0]), min(far, ends[1])
    return near if near < far else math.inf


def write(scene, light):
    """Makes or changes one light object."""
    obj = scene.objects.get(light["name"])
    if obj is None:
        data = bpy.data.lights.new(light["name"], light["type"])
        obj = bpy.data.objects.new(light["name"], data)
        obj.visible_camera = False
        scene.collection.objects.link(obj)
    elif obj.data.type != light["type"]:
        obj.data.type = light["type"]
    obj.matrix_world = Matrix(light["world_from_object"])
    data = obj.data
    data.energy, data.color = light["energy"], light["color"]
    for key, value in light.items():
        if key in SETTINGS:
            setattr(data, {"radius": "shadow_soft_size"}.get(key, key), value)


def remove(objects):
    """Deletes light objects and their data."""
    for obj in objects:
        data = obj.data
        bpy.data.objects.remove(obj)
        if not data.users:
            bpy.data.lights.remove(data)


def switch_off(*owners):
    """Sets every emission of worlds and materials to 0."""
    for owner in owners:
        for node in owner.node_tree.nodes if owner and owner.node_tree else ():
            for name in ("Emission Strength", "Strength"):
                closure = node.bl_idname in {"ShaderNodeBackground", "ShaderNodeEmission", "ShaderNodeBsdfPrincipled"}
                if closure and name in node.inputs:
                    for link in node.inputs[name].links:
                        owner.node_tree.links.remove(link)
                    node.inputs[name].default_value = 0.0


def print_error(message):
    """Where the client does not listen."""
    print(message, file=sys.stderr)


def main():
    bpy.ops.preferences.addon_enable(module="cycles")
    judge = Judge()
    for line in sys.stdin:
        request = json.loads(line)
        answer = getattr(judge, request.pop("do"))(**request)
        print(json.dumps(answer), file=ANSWERS, flush=True)


if __name__ == "__main__":
    main()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
