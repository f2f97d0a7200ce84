"""Finds a sphere light with Mitsuba 3's gradients, as in the paper's figure 9: one JSON line a run on standard output.

Each input line is a run: `target` and `start` (center, radius, radiance), `space` (min, max, size), `seed`. Position
and radius pass a logistic function within the bounds, radiance a softplus in units of the start's; the loss is the mean
squared error of Reinhard-tonemapped pictures; Adam. A sphere that moves changes what is seen only where its outline
moves, which plain path replay does not differentiate (its gradient by position and radius is 0), hence
`prb_projective`: without guiding, whose octree takes many seconds a step on a processor, and without the outline that
the camera sees, since the light is hidden from it. Dr.Jit cannot freeze this integrator, so that each step is traced
anew: `mitsuba_atlas` leaves it few BSDFs to go through. Nor is Embree's tree built anew whenever the lamp moves, which
in a large scene would take most of a step (`lamp_anywhere`). The clock runs while steps run; kernels of each sample
count are compiled before. With one thread it is the processor's, which other work on the machine does not lengthen.
"""

import argparse
import json
import math
import sys
import time
from pathlib import Path
from xml.etree import ElementTree as Xml

import mitsuba as mi

mi.set_variant("llvm_ad_rgb")
# Its log goes to standard output as well.
mi.set_log_level(mi.LogLevel.Error)

import drjit as dr  # noqa: E402
from mitsuba_atlas import share_bsdf  # noqa: E402

SCHEDULE = ((0, 8), (100, 16), (300, 32))
"""First step, samples per pixel."""
LEARNING_RATE = 0.05
TARGET_SAMPLES = 2048
LAMP = "lamp"


def load(path, size, depth):
    """The scene without its own emitters, lit by one sphere that the camera does not see."""
    tree = Xml.parse(path)
    scene = tree.getroot()
    for shape in scene.findall("shape"):
        if shape.find("emitter") is not None and shape.get("type") != "ply":
            scene.remove(shape)
        for emitter in shape.findall("emitter"):
            shape.remove(emitter)
    for emitter in scene.findall("emitter"):
        scene.remove(emitter)
    share_bsdf(scene, Path(path).parent)
    integrator = scene.find("integrator")
    integrator.set("type", "prb_projective")
    Xml.SubElement(integrator, "string", name="guiding", value="none")
    Xml.SubElement(integrator, "integer", name="sppp", value="0")
    Xml.SubElement(integrator, "boolean", name="hide_emitters", value="true")
    lamp = Xml.SubElement(scene, "shape", type="sphere", id=LAMP)
    emitter = Xml.SubElement(lamp, "emitter", type="area")
    Xml.SubElement(emitter, "rgb", name="radiance", value="1 1 1")
    beside = str(path).replace("scene.xml", "solve.xml")
    tree.write(beside)
    return mi.load_file(beside, resx=size[0], resy=size[1], max_depth=depth)


class Light:
    """The sphere's seven parameters, unconstrained."""

    def __init__(self, space, unit):
        self.low = [*space["min"], space["size"][0]]
        self.high = [*space["max"], space["size"][1]]
        self.unit = unit

    def unconstrained(self, light):
        """Seven numbers of a light."""
        values = [*light["center"], light["radius"]]
        shares = [(v - a) / (b - a) for v, a, b in zip(values, self.low, self.high, strict=True)]
        shares = [min(max(share, 1e-3), 1 - 1e-3) for share in shares]
        logits = [dr.log(share / (1 - share)) for share in shares]
        return [*logits, *(dr.log(dr.exp(value / self.unit) - 1) for value in light["radiance"])]

    def constrained(self, u):
        """Centre, radius and radiance of seven numbers."""
        ends = zip(self.low, self.high, u[:4], strict=True)
        *center, radius = [a + (b - a) / (1 + dr.exp(-x)) for a, b, x in ends]
        return center, radius, [self.unit * dr.log(1 + dr.exp(x)) for x in u[4:]]


def lamp_anywhere(scene, space):
    """The lamp's parameters, which can be changed without the scene noticing. Embree looks for the lamp within the box
    that it had when its tree was built, and asks the lamp itself where it is: so the tree is built with a lamp that
    fills all of the space that it may be in. That its place has gradients is noticed then as well."""
    center = mi.Point3f(space["min"]) + mi.Vector3f(space["max"])
    radius = mi.Float(math.dist(space["min"], space["max"]) / 2 + space["size"][1])
    dr.enable_grad(radius)
    params = mi.traverse(scene)
    params[f"{LAMP}.to_world"] = sphere(center / 2, radius)
    params.update()
    return mi.traverse(next(shape for shape in scene.shapes() if shape.id() == LAMP))


def sphere(center, radius):
    """From the unit sphere."""
    return mi.Transform4f().translate(mi.Point3f(center)).scale(mi.Point3f(radius))


def place(params, center, radius, radiance):
    """Moves the lamp."""
    params["to_world"] = sphere(mi.Point3f(*center), radius)
    params["emitter.radiance.value"] = mi.Color3f(*radiance)
    params.update()


def tonemap(picture, exposure):
    """Reinhard's curve."""
    x = picture * exposure
    return x / (1 + x)


class Run:
    """One light to be found."""

    def __init__(self, scene, request):
        self.scene, self.params = scene, lamp_anywhere(scene, request["space"])
        target = request["target"]
        place(self.params, target["center"], target["radius"], target["radiance"])
        picture = mi.render(scene, spp=TARGET_SAMPLES, seed=request["seed"])
        self.exposure = 0.5 / dr.mean(picture, axis=None).array[0]
        self.target = tonemap(picture, self.exposure)
        self.light = Light(request["space"], sum(request["start"]["radiance"]) / 3)
        self.u = [mi.Float(x) for x in self.light.unconstrained(request["start"])]
        self.seed = request["seed"]

    def gradient(self, samples, seed):
        """By the seven numbers."""
        u = [mi.Float(x) for x in self.u]
        dr.enable_grad(u)
        place(self.params, *self.light.constrained(u))
        picture = mi.render(self.scene, self.params, spp=samples, seed=seed)
        dr.backward(dr.mean(dr.square(tonemap(picture, self.exposure) - self.target), axis=None))
        return [dr.grad(x)[0] for x in u]

    def solve(self, steps, clock):
        """(seconds, centre, radius, radiance) after every step."""
        for _, samples in SCHEDULE:
            self.gradient(samples, 0)
        first, second = [0.0] * 7, [0.0] * 7
        trajectory, start = [self.state(0.0)], clock()
        for step in range(steps):
            samples = [count for begin, count in SCHEDULE if begin <= step][-1]
            gradient = self.gradient(samples, self.seed + step + 1)
            for i, g in enumerate(gradient):
                g = g if g == g else 0.0
                first[i], second[i] = 0.9 * first[i] + 0.1 * g, 0.999 * second[i] + 0.001 * g * g
                mean, spread = first[i] / (1 - 0.9 ** (step + 1)), second[i] / (1 - 0.999 ** (step + 1))
                self.u[i] -= LEARNING_RATE * mean / (spread**0.5 + 1e-8)
            trajectory.append(self.state(clock() - start))
        return trajectory

    def state(self, seconds):
        """A point of the trajectory."""
        center, radius, radiance = self.light.constrained(self.u)
        numbers = [[float(x[0]) for x in center], float(radius[0]), [float(x[0]) for x in radiance]]
        return [round(seconds, 3), *numbers]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene", help="scene.xml")
    parser.add_argument("--width", type=int, required=True)
    parser.add_argument("--height", type=int, required=True)
    parser.add_argument("--bounces", type=int, required=True)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True, help="0 for one a core")
    args = parser.parse_args()
    if args.threads:
        dr.set_thread_count(args.threads)
    clock = time.process_time if args.threads == 1 else time.perf_counter
    # Mitsuba counts the segments up to the light: Blender's bounces + camera segment + light segment.
    scene = load(args.scene, (args.width, args.height), args.bounces + 2)
    for line in sys.stdin:
        trajectory = Run(scene, json.loads(line)).solve(args.steps, clock)
        print(json.dumps({"method": f"Mitsuba {mi.__version__} prb_projective", "trajectory": trajectory}), flush=True)


if __name__ == "__main__":
    main()
