"""Error of the pictures that are drawn while a light is dragged, against the settled picture of the same place.

In a Python that has `bpy` and `relume`. One JSON line on standard output for each light and method: mean PSNR
(Reinhard) and milliseconds of the first picture after each of a few moves. `--lamps` adds as many lamps to the shot, in
the room between the camera and what it looks at.
"""

import argparse
import json
import random
import statistics
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts" / "bench")]

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from live import Shot  # noqa: E402
from mathutils import Vector  # noqa: E402

MOVES = 6
REACH = 0.2
"""Metres that a light is moved at most, along each axis."""
SPREAD = 0.4
"""Share of the way to the middle of the view that lamps lie to its sides."""


def add_lamps(count, radius):
    """Point lamps at random places in view, at 0.3 to 0.9 of the way to what the camera sees in the middle."""
    scene, numbers = bpy.context.scene, random.Random(1)
    camera = scene.camera.matrix_world
    origin, ahead = camera.translation, -camera.col[2].xyz.normalized()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hit, place, *_ = scene.ray_cast(depsgraph, origin, ahead)
    way = (place - origin).length if hit else 5.0
    for number in range(count):
        share, aside = numbers.uniform(0.3, 0.9), SPREAD * way
        offset = Vector(numbers.uniform(-aside, aside) for _ in range(3)) * share
        light = bpy.data.lights.new(f"Lamp {number}", "POINT")
        light.energy, light.shadow_soft_size = 50.0 * way, radius
        lamp = bpy.data.objects.new(light.name, light)
        lamp.location = origin + ahead * (way * share) + offset * 0.5
        scene.collection.objects.link(lamp)


def psnr(picture, settled):
    """Decibels after Reinhard's curve, exposed so that the settled picture has a mean of a half."""
    exposure = 0.5 / settled.mean()
    a, b = (np.maximum(image * exposure, 0.0) for image in (picture, settled))
    error = np.mean((a / (1.0 + a) - b / (1.0 + b)) ** 2)
    return float(-10.0 * np.log10(max(error, 1e-12)))


def whole(frame):
    """Pixels of a frame at its full size."""
    return np.repeat(np.repeat(frame.image[..., :3], frame.scale, axis=0), frame.scale, axis=1)


def measure(shot, light, method, half, numbers):
    """Moves a light to places where it was not before: decibels and milliseconds of each first picture."""
    errors, times, makers = [], [], set()
    center = list(shot.lights[light]["shape"]["center"])
    for _ in range(MOVES):
        shot.lights[light]["shape"]["center"] = [x + numbers.uniform(-REACH, REACH) for x in center]
        took, drawn = shot.ask(interactive=True, half=half, **{"with": method})
        summary = json.loads(drawn.summary)
        makers.add(summary["makers"][shot.lights[light]["name"]])
        picture = whole(drawn)
        settled = shot.ask(interactive=False, half=False, **{"with": "gather"})[1]
        while not json.loads(settled.summary)["settled"]:
            settled = shot.next_frame()
        reference = whole(settled)
        errors.append(psnr(picture[: len(reference), : reference.shape[1]], reference))
        times.append(took)
    shot.lights[light]["shape"]["center"] = center
    return {"psnr": statistics.mean(errors), "ms": statistics.median(times), "makers": sorted(makers)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("blend", type=Path)
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--height", type=int, default=270)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--train-seconds", type=float, default=20.0)
    parser.add_argument("--lamps", type=int, default=0)
    parser.add_argument("--radius", type=float, default=0.05)
    parser.add_argument("--device", default="cpu")
    args = parser.parse_args()
    bpy.ops.wm.open_mainfile(filepath=str(args.blend))
    add_lamps(args.lamps, args.radius)
    with tempfile.TemporaryDirectory() as folder:
        size = (args.width, args.height)
        shot = Shot(folder, size, args.samples, args.train_seconds, args.device)
        shot.wait_until_done()
        numbers = random.Random(2)
        round_ones = [i for i, light in enumerate(shot.lights) if "radius" in light["shape"]]
        for light in round_ones[-2:] if args.lamps else round_ones[:1]:
            for method in ("auto", "gather", "proxy"):
                for half in (False, True):
                    found = measure(shot, light, method, half, numbers)
                    about = {"shot": args.blend.stem, "lamps": args.lamps, "light": shot.lights[light]["name"]}
                    print(json.dumps(about | {"method": method, "half": half} | found), flush=True)
        shot.live.close(wait_seconds=10)


if __name__ == "__main__":
    main()
