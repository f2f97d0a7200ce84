"""Error of the pictures that are drawn while lights are dragged, each against the settled picture of the same places.

In a Python that has `bpy` and `relume`. One JSON line on standard output for each drag and method: PSNR (Reinhard) and
milliseconds of its pictures. `--lamps` adds as many lamps to the shot, in the room between the camera and what it looks
at; the last of them is dragged alone, then all together. `--keep STATE` keeps the records under this name in
`docs/bench/drags.json` and writes the page beside it.
"""

import argparse
import json
import os
import random
import statistics
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts" / "bench")]

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from live import Shot, processor  # noqa: E402
from markdown import rows  # noqa: E402
from mathutils import Vector  # noqa: E402

KEPT = ROOT / "docs" / "bench" / "drags.json"
MOVES = 6
STEP = 0.1
"""Metres that a light goes at most from one picture to the next, along each axis."""
SPREAD = 0.4
"""Share of the way to the middle of the view that lamps lie to its sides."""
APART = 1e-4
"""Metres between the places of two methods, so that none finds what another has made."""
METHODS = ("proxy", "auto", "gather")

TEXT = """# Pictures of a drag

Made by `scripts/bench/drags.py` from `drags.json`. Lamps are added to a shot, and one or all of them go from place to
place. Each picture that is drawn meanwhile is compared with the settled picture of the same places. Figures are means
over {moves} pictures, then the worst; PSNR in dB after Reinhard's curve. *Auto* is what an artist sees. *Proxy* and
*gather* are what either shows alone. Milliseconds are from a request to its picture, the median and the longest.
*Before*, a light that was late went to its proxy at once; *after*, it is connected in blocks of pixels first.
*Others* are the threads that wanted the machine's cores when it began: what is in time depends on them.

{table}
"""


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


def settle(shot):
    """The settled picture of the lights where they are."""
    settled = shot.ask(interactive=False, **{"with": "gather"})[1]
    while not json.loads(settled.summary)["settled"]:
        settled = shot.next_frame()
    return whole(settled)


class Drag:
    """Some lights of a shot, and the places that they go through."""

    def __init__(self, shot, moved):
        self.shot, self.moved = shot, moved
        self.starts = {light: list(shot.lights[light]["shape"]["center"]) for light in moved}
        numbers = random.Random(2)
        self.places = [{light: [0.0] * 3 for light in moved}]
        for _ in range(MOVES):
            before = self.places[-1]
            step = {light: [x + numbers.uniform(-STEP, STEP) for x in before[light]] for light in moved}
            self.places.append(step)
        self.references = []

    def put(self, place, apart=0.0):
        """Moves the lights to one of the places."""
        for light, start in self.starts.items():
            shift = self.places[place][light]
            self.shot.lights[light]["shape"]["center"] = [a + b + apart for a, b in zip(start, shift, strict=True)]

    def refer(self):
        """Makes the settled picture of each place."""
        for place in range(1, MOVES + 1):
            self.put(place)
            self.references.append(settle(self.shot))

    def measure(self, method):
        """Errors and times of the pictures of a drag by a method."""
        apart = APART * (1 + METHODS.index(method))
        self.put(0, apart)
        settle(self.shot)
        pictures, times, makers = [], [], set()
        for place in range(1, MOVES + 1):
            self.put(place, apart)
            took, drawn = self.shot.ask(interactive=True, **{"with": method})
            of_lights = json.loads(drawn.summary)["makers"]
            makers |= {of_lights[self.shot.lights[light]["name"]] for light in self.moved}
            pictures.append(drawn)
            times.append(took)
        found = []
        for drawn, settled in zip(pictures, self.references, strict=True):
            picture = whole(drawn)
            found.append(psnr(picture, settled[: len(picture), : picture.shape[1]]))
        return {
            "method": method,
            "moved": len(self.moved),
            "psnr": round(statistics.mean(found), 2),
            "worst_psnr": round(min(found), 2),
            "ms": round(statistics.median(times), 1),
            "longest_ms": round(max(times), 1),
            "scale": max(drawn.scale for drawn in pictures),
            "makers": sorted(makers),
        }


def page(records):
    """The page over all records."""
    heads = ["shot", "lamps, moved", "method", "version", "PSNR", "worst", "ms", "longest", "machine", "others"]
    lines = []
    for record in sorted(records, key=lambda r: (r["shot"], r["lamps"], r["moved"], r["method"])):
        width, height = record["size"]
        lines.append(
            [
                f"{record['shot']}, {width} x {height}",
                f"{record['lamps']}, {record['moved']}",
                record["method"],
                f"{record['version']}, {record['date']}",
                f"{record['psnr']:.1f}",
                f"{record['worst_psnr']:.1f}",
                f"{record['ms']:.0f}",
                f"{record['longest_ms']:.0f}",
                record["machine"],
                f"{record['others']:g}",
            ]
        )
    return TEXT.format(moves=MOVES, table=rows(heads, lines))


def keep(records):
    """Puts records in the place of those of the same drags, and writes the page."""

    def about(record):
        return [record[name] for name in ("shot", "size", "lamps", "moved", "method", "version", "machine")]

    known = json.loads(KEPT.read_text()) if KEPT.exists() else []
    new = [about(record) for record in records]
    kept = [record for record in known if about(record) not in new] + records
    KEPT.write_text("[\n" + ",\n".join(json.dumps(record) for record in kept) + "\n]\n")
    KEPT.with_suffix(".md").write_text(page(kept))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("blend", type=Path)
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--height", type=int, default=270)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--train-seconds", type=float, default=20.0)
    parser.add_argument("--lamps", type=int, default=1)
    parser.add_argument("--radius", type=float, default=0.05)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--folder", type=Path, help="of a bake that is kept, and gone on with if it is there")
    parser.add_argument("--keep", metavar="VERSION", help="what is measured, as before or after a change")
    args = parser.parse_args()
    others = os.getloadavg()[0]
    bpy.ops.wm.open_mainfile(filepath=str(args.blend))
    add_lamps(args.lamps, args.radius)
    about = {
        "shot": args.blend.stem,
        "size": [args.width, args.height],
        "lamps": args.lamps,
        "samples": args.samples,
        "version": args.keep,
        "machine": f"{processor()}, {os.cpu_count()} cores",
        "others": round(others, 1),
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
    }
    records = []
    with tempfile.TemporaryDirectory() as folder:
        size = (args.width, args.height)
        shot = Shot(str(args.folder or folder), size, args.samples, args.train_seconds, args.device)
        shot.wait_until_done()
        lamps = [i for i, light in enumerate(shot.lights) if light["name"].startswith("Lamp ")]
        for moved in [lamps[-1:], lamps][: 1 + (len(lamps) > 1)]:
            drag = Drag(shot, moved)
            drag.refer()
            for method in METHODS:
                records.append(about | drag.measure(method))
                print(json.dumps(records[-1]), flush=True)
            drag.put(0)
        shot.live.close(wait_seconds=10)
    if args.keep:
        keep(records)


if __name__ == "__main__":
    main()
