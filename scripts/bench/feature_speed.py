"""Paths per second on scenes of one feature beside Cycles in the same run, in a Python that has `bpy` and `relume`.

    .venv-4.2/bin/python scripts/bench/feature_speed.py [SCENE...]

One thread each, in seconds of the processor, so that other work on the machine counts little. Each side renders at two
sample counts in turn with the other; the slope leaves out reading and trees. Replaces the records of its scenes and
Blender version in `docs/bench/features/records.json`, and writes the page beside it anew.
"""

import argparse
import datetime
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import bpy
import relume

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), *(str(ROOT / "scripts" / name) for name in ("parity", "hunt", "bench"))]
import hair  # noqa: E402
from markdown import rows  # noqa: E402

import cycles_reference  # noqa: E402
import features  # noqa: E402
import features.stage  # noqa: E402
import light_sets  # noqa: E402
from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.export import trace_settings  # noqa: E402

SCENES = ("ribbon_hair", "round_hair", "tuft_chiang", "wax", "fog_box", "hair_head")
SIZE = 128, 96
RECORDS = ROOT / "docs/bench/features/records.json"
VERSION = f"{bpy.app.version[0]}.{bpy.app.version[1]}"
TEXT = """# Scenes of one feature beside Cycles

Made by `.venv-4.2/bin/python scripts/bench/feature_speed.py`: camera paths in thousands per second of one core.
`hair_head` is a head of {strands} strands of {keys} keys; the others are scenes of `scripts/parity/features`.
Cycles looks for lights at each bounce, Relume records paths for lights to come.

{table}
"""
HEAD = ("scene", "Blender", "date", "Relume", "Cycles", "ratio")


def open_scene(name):
    """A scene under lights of all kinds, ready for both renderers."""
    if name == "hair_head":
        scene = hair.make_scene(hair.STRANDS)
    else:
        scene = features.stage.set_up(*SIZE)
        features.SCENES[name](scene)
        light_sets.add_light_set(scene, 1)
    cycles_reference.prepare(scene, *SIZE)
    # With persistent data Blender would not notice another sample count.
    scene.render.use_persistent_data = False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    return scene


def cycles_seconds(scene, samples):
    """Seconds of the processor for one render by Cycles."""
    scene.cycles.samples = samples
    start = time.process_time()
    bpy.ops.render.render()
    return time.process_time() - start


def relume_seconds(loaded, settings, samples):
    """Seconds of the processor for one bake."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.process_time()
        relume.bake(loaded, Path(folder) / "bake", settings | {"samples": samples, "threads": 1}).wait()
        return time.process_time() - start


def measure(name, samples, rounds):
    """The record of a scene: of each side the quickest of its rounds at each sample count."""
    scene = open_scene(name)
    loaded, settings = load_scene(scene), trace_settings(scene, print)
    counts = samples // 4, samples
    sides = (lambda count: relume_seconds(loaded, settings, count)), (lambda count: cycles_seconds(scene, count))
    times = [[[side(count) for count in counts] for side in sides] for _ in range(rounds)]
    paths = SIZE[0] * SIZE[1] * (counts[1] - counts[0])
    few_many = [[min(one[side][count] for one in times) for count in (0, 1)] for side in (0, 1)]
    ours, peer = (paths / (many - few) for few, many in few_many)
    return {
        "scene": name,
        "version": VERSION,
        "date": datetime.date.today().isoformat(),
        "size": SIZE,
        "samples": counts,
        "paths_per_second": round(ours),
        "peer": f"Cycles {bpy.app.version_string}",
        "peer_paths_per_second": round(peer),
        "ratio": round(ours / peer, 3),
    }


def page(records):
    """The page of kept figures."""

    def cells(record):
        thousands = [f"{record[key] / 1000:.1f}" for key in ("paths_per_second", "peer_paths_per_second")]
        return [record["scene"], record["version"], record["date"], *thousands, f"{record['ratio']:.2f}"]

    return TEXT.format(strands=hair.STRANDS, keys=hair.KEYS, table=rows(list(HEAD), map(cells, records)))


def keep(record):
    """Replaces the record of a scene in this Blender, and the page."""
    records = json.loads(RECORDS.read_text()) if RECORDS.exists() else []
    same = record["scene"], record["version"]
    records = [old for old in records if (old["scene"], old["version"]) != same] + [record]
    records.sort(key=lambda old: (old["scene"], old["version"]))
    RECORDS.parent.mkdir(parents=True, exist_ok=True)
    RECORDS.write_text(json.dumps(records, indent=1) + "\n")
    RECORDS.with_name("README.md").write_text(page(records))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE", help=", ".join(SCENES))
    parser.add_argument("--samples", type=int, default=32)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--try", action="store_true", dest="is_trial", help="keep nothing")
    args = parser.parse_args()
    for name in args.scenes:
        record = measure(name, args.samples, args.rounds)
        print(json.dumps(record), flush=True)
        if not args.is_trial:
            keep(record)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
