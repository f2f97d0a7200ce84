"""How soon an artist sees something: seconds and milliseconds of a live shot, without Blender's drawing. In a Python
that has `bpy` and `relume`: one JSON line with records on standard output.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import relume  # noqa: E402

from addon.engine.scene import load_scene  # noqa: E402
from addon.export import ExportOptions, trace_settings  # noqa: E402

REPEATS = 9


class Shot:
    """A live shot of the open file, and how long it takes to answer."""

    def __init__(self, folder, size, samples, train_seconds):
        self.start = time.perf_counter()
        scene = load_scene(bpy.context.scene, ExportOptions(resolution=size))
        self.lights = json.loads(scene.lights())
        self.live = relume.Live(folder)
        self.seen = 0
        self.live.relight(json.dumps({"lights": self.lights}))
        settings = trace_settings(bpy.context.scene, lambda warning: None) | {"samples": samples}
        self.live.bake(scene, settings, train_seconds=train_seconds)

    def next_frame(self, wanted=lambda frame: True):
        """Waits for a frame."""
        while True:
            frame = self.live.frame(self.seen)
            if frame and wanted(frame):
                self.seen = frame.serial
                return frame
            time.sleep(0.0005)

    def wait_until_done(self):
        """Waits for the end of baking and training and the final frame."""
        while (state := json.loads(self.live.status())["state"]) != "ready":
            if state == "failed":
                raise SystemExit(json.loads(self.live.status())["error"])
            time.sleep(0.05)
        self.next_frame(lambda frame: json.loads(frame.summary)["settled"])

    def milliseconds(self, **request):
        """Time from a request to its first frame."""
        start = time.perf_counter()
        number = self.live.relight(json.dumps({"lights": self.lights} | request))
        self.next_frame(lambda frame: frame.request == number)
        return 1000 * (time.perf_counter() - start)

    def move(self):
        """Shifts the first light by a centimetre."""
        self.lights[0]["shape"]["center"][0] += 0.01


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blend", type=Path)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--height", type=int, default=540)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--train-seconds", type=float, default=5.0, help="quality does not matter here")
    args = parser.parse_args()
    bpy.ops.wm.open_mainfile(filepath=str(args.blend))
    label = f"{args.blend.stem}, {args.width} x {args.height}"
    records = []

    def record(name, value, unit, goal):
        records.append({"name": f"{name}, {label}", "value": value, "unit": unit, "goal": goal})

    with tempfile.TemporaryDirectory() as folder:
        shot = Shot(folder, (args.width, args.height), args.samples, args.train_seconds)
        shot.next_frame()
        record("first picture", time.perf_counter() - shot.start, "s", 5)
        shot.wait_until_done()
        name = shot.lights[0]["name"]
        edits = [shot.milliseconds(gains={name: [1 + i / 10] * 3}, interactive=True) for i in range(REPEATS)]
        record("edit of a strength", statistics.median(edits), "ms", 16)
        drags = []
        for _ in range(REPEATS):
            shot.move()
            drags.append(shot.milliseconds(interactive=True))
        record("one light moved, by its proxy", statistics.median(drags), "ms", 200)
        drags = []
        for _ in range(REPEATS):
            shot.move()
            drags.append(shot.milliseconds(interactive=True, **{"with": "gather"}))
        record("one light moved, by samples", statistics.median(drags), "ms", 200)
        shot.live.close(wait_seconds=10)
    print(json.dumps({"records": records}), flush=True)


if __name__ == "__main__":
    main()
