"""Delay of the active picture while a light is dragged, alone and beside other shots that follow the same light: while
these still prepare what their better pictures need, and at rest.

In a Python that has `bpy` and `relume`. All shots show the same bake, each by threads of its own, and take turns on one
board as in Blender's window. Prints one JSON line; `--keep` writes it to `docs/bench/views.json`.
"""

import argparse
import json
import os
import shutil
import statistics
import sys
import tempfile
import time
from datetime import UTC, datetime
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "scripts" / "bench")]

import bpy  # noqa: E402
import relume  # noqa: E402
from live import Shot, processor  # noqa: E402

KEPT = ROOT / "docs/bench/views.json"
TICK_SECONDS = 0.02


def drag(lights, active, others, seconds):
    """Milliseconds from each request to its picture in the active shot, and the pictures that each other one showed."""
    asked, delays, seen, start = {}, [], 0, time.perf_counter()
    newest, shown = [getattr(shot.frame(0), "serial", 0) for shot in others], [0] * len(others)
    while time.perf_counter() < start + seconds:
        lights[0]["shape"]["center"][0] += 0.01 if len(asked) % 20 < 10 else -0.01
        content = {"lights": lights, "interactive": True}
        # At full size, so that pictures alone and beside others are as large.
        asked[active.relight(relume.Request.parse(json.dumps(content | {"half": False})))] = time.perf_counter()
        request = relume.Request.parse(json.dumps(content))
        for shot in others:
            shot.relight(request)
        time.sleep(TICK_SECONDS)
        if (frame := active.frame(seen)) is not None:
            seen = frame.serial
            if frame.request in asked:
                delays.append(1000.0 * (time.perf_counter() - asked[frame.request]))
        for number, shot in enumerate(others):
            if (frame := shot.frame(newest[number])) is not None:
                newest[number], shown[number] = frame.serial, shown[number] + 1
    return delays, shown


def opened(folder, board):
    """A live shot with its first settled picture."""
    shot = relume.Live(str(folder), device="cpu", board=board)
    shot.open()
    return shot


def settle(shots, lights):
    """Waits for settled pictures of all shots."""
    request = relume.Request.parse(json.dumps({"lights": lights}))
    numbers = [shot.relight(request) for shot in shots]
    for shot, number in zip(shots, numbers, strict=True):
        # The status says whether vertices are still prepared.
        while (shown := shot.status().shown or {}).get("request") != number or not shown["settled"]:
            time.sleep(0.05)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("blend", type=Path)
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--height", type=int, default=270)
    parser.add_argument("--samples", type=int, default=16)
    parser.add_argument("--shots", type=int, default=9)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--keep", action="store_true")
    args = parser.parse_args()
    bpy.ops.wm.open_mainfile(filepath=str(args.blend))
    with tempfile.TemporaryDirectory() as folder:
        first = Shot(f"{folder}/0", (args.width, args.height), args.samples, 0.0, "cpu")
        first.wait_until_done()
        first.live.close(wait_seconds=10)
        board, lights = relume.Board(), first.lights
        active = opened(f"{folder}/0", board)
        active.attend()
        settle([active], lights)
        alone, _ = drag(lights, active, [], args.seconds)
        others = []
        for number in range(1, args.shots):
            others.append(opened(shutil.copytree(f"{folder}/0", f"{folder}/{number}"), board))
        preparing, _ = drag(lights, active, others, args.seconds)
        settle([active, *others], lights)
        beside, shown = drag(lights, active, others, args.seconds)
        for shot in (active, *others):
            shot.close(wait_seconds=10)
    one, among_busy, several = map(statistics.mean, (alone, preparing, beside))
    record = {
        "shot": args.blend.stem,
        "size": [args.width, args.height],
        "samples": args.samples,
        "shots": args.shots,
        "alone_ms": round(one, 1),
        "beside_preparing_ms": round(among_busy, 1),
        "beside_ms": round(several, 1),
        "later_while_preparing_percent": round(100.0 * (among_busy / one - 1.0), 1),
        "later_percent": round(100.0 * (several / one - 1.0), 1),
        "active_pictures_a_second": [round(len(found) / args.seconds, 1) for found in (alone, beside)],
        "least_pictures_of_another_a_second": round(min(shown) / args.seconds, 2),
        "machine": f"{processor()}, {os.cpu_count()} cores",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
    }
    print(json.dumps(record))
    if args.keep:
        KEPT.write_text(json.dumps([record], indent=1) + "\n")


if __name__ == "__main__":
    main()
