"""How soon an artist sees something: seconds and milliseconds of a live shot, without Blender's drawing. In a Python
that has `bpy` and `relume`: one JSON line with records on standard output. With --keep also a file of this machine in
docs/bench/live, a record on each line, and the page over all machines there.
"""

import argparse
import json
import os
import platform
import statistics
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import bpy  # noqa: E402
import relume  # noqa: E402
from live_table import page  # noqa: E402

from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.export import ExportOptions, trace_settings  # noqa: E402

REPEATS = 9
KEPT = ROOT / "docs" / "bench" / "live"


class Shot:
    """A live shot of the open file, and how long it takes to answer."""

    def __init__(self, folder, size, samples, train_seconds, device):
        self.start = time.perf_counter()
        scene = load_scene(bpy.context.scene, ExportOptions(resolution=size))
        self.lights = json.loads(scene.lights())
        self.live = relume.Live(folder, device=device)
        self.seen = 0
        self.live.relight(relume.Request.parse(json.dumps({"lights": self.lights})))
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
        while (status := self.live.status()).state != "ready":
            if status.state == "failed":
                raise SystemExit(status.error)
            time.sleep(0.05)
        self.next_frame(lambda frame: json.loads(frame.summary)["settled"])

    def ask(self, **request):
        """Milliseconds from a request to its first frame, and that frame."""
        start = time.perf_counter()
        number = self.live.relight(relume.Request.parse(json.dumps({"lights": self.lights} | request)))
        frame = self.next_frame(lambda frame: frame.request == number)
        return 1000 * (time.perf_counter() - start), frame

    def drag(self, maker, scale, **request):
        """Milliseconds from moving the first light by a centimetre to the frame that shows it."""
        self.lights[0]["shape"]["center"][0] += 0.01
        took, frame = self.ask(interactive=True, half=scale == 2, **request)
        made_by = json.loads(frame.summary)["makers"][self.lights[0]["name"]]
        if (made_by, frame.scale) != (maker, scale):
            raise SystemExit(f"the dragged light was shown by {made_by} at scale {frame.scale}, not {maker} at {scale}")
        return took


def processor():
    """Its name, where the system tells."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, platform.processor() or platform.machine())


def keep(records, machine, others):
    """Keeps the figures of a machine. `others`: how many other threads wanted its cores on average when it began."""
    about = {
        "machine": f"{processor()}, {os.cpu_count()} cores",
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M"),
        "others": round(others, 1),
    }
    KEPT.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(json.dumps(record | about) for record in records)
    (KEPT / f"{machine}.json").write_text(f"[\n{lines}\n]\n")
    (KEPT / "README.md").write_text(page(KEPT))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blend", type=Path)
    parser.add_argument("--width", type=int, default=960)
    parser.add_argument("--height", type=int, default=540)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--train-seconds", type=float, default=5.0, help="quality does not matter here")
    parser.add_argument("--device", default="cpu", help="cpu, gpu or a part of a GPU's name, as in `relume devices`")
    parser.add_argument("--keep", metavar="MACHINE", help="name of this machine in docs/bench/live")
    args = parser.parse_args()
    others = os.getloadavg()[0]
    bpy.ops.wm.open_mainfile(filepath=str(args.blend))
    label = f"{args.blend.stem}, {args.width} x {args.height}"
    # Goal for a light that moves: issue 4, "Times in a benchmark".
    move_goal = 200 if args.device == "cpu" else 16
    records = []

    def record(name, value, unit, goal, **more):
        records.append({"name": f"{name}, {label}", "value": value, "unit": unit, "goal": goal} | more)

    with tempfile.TemporaryDirectory() as folder:
        shot = Shot(folder, (args.width, args.height), args.samples, args.train_seconds, args.device)
        frame = shot.next_frame()
        record("first picture", time.perf_counter() - shot.start, "s", 5, scale=frame.scale)
        if frame.scale > 1:
            frame = shot.next_frame(lambda frame: frame.scale == 1)
        record("first picture of all pixels", time.perf_counter() - shot.start, "s", None, scale=frame.scale)
        shot.wait_until_done()
        device = json.loads(shot.live.status())["device"]
        name = shot.lights[0]["name"]
        edits = [shot.ask(gains={name: [1 + i / 10] * 3}, interactive=True, half=False)[0] for i in range(REPEATS)]
        record("edit of a strength", statistics.median(edits), "ms", 16)
        for words, maker, source, scale, goal in (
            ("by its proxy at half resolution", "proxy", "proxy", 2, move_goal),
            ("by its proxy", "proxy", "proxy", 1, None),
            ("by samples at half resolution", "gather_denoised", "gather", 2, None),
        ):
            drags = [shot.drag(maker, scale, **{"with": source}) for _ in range(REPEATS)]
            record(f"one light moved, {words}", statistics.median(drags), "ms", goal, scale=scale)
        shot.live.close(wait_seconds=10)
    records = [record | {"device": device} for record in records]
    print(json.dumps({"records": records}), flush=True)
    if args.keep:
        keep(records, args.keep, others)


if __name__ == "__main__":
    main()
