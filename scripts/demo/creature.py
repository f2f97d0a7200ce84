"""The second demo: fog, skin and hair under three lightings, from one bake. Leaves overview.png in a folder."""

import argparse
import json
import subprocess
import sys
from pathlib import Path

from run import RELUME, ROOT, write_overview

EVENING = [
    {
        "name": "Window",
        "radiance": [60.0, 27.0, 9.0],
        "shape": {
            "type": "quad",
            "center": [2.0, 0.9, 1.9],
            "edge_u": [0.0, -1.3, 0.0],
            "edge_v": [-0.3, 0.0, 1.2],
            "spread": 1.4,
        },
    },
    {
        "name": "Lantern",
        "radiance": [3.0, 6.0, 16.0],
        "shape": {"type": "sphere", "center": [-1.7, -0.6, 1.6], "radius": 0.25},
    },
]
NIGHT = [
    {
        "name": "Moon",
        "radiance": [200.0, 330.0, 600.0],
        "shape": {"type": "sphere", "center": [0.3, 1.75, 2.9], "radius": 0.16},
    },
    {
        "name": "Ember",
        "radiance": [140.0, 40.0, 9.0],
        "shape": {"type": "sphere", "center": [1.0, -1.0, 0.3], "radius": 0.12},
    },
]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "creature")
    parser.add_argument("--samples", type=int, default=256)
    args = parser.parse_args()
    out = args.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    blend, bake = out / "creature.blend", out / "bake"
    run(sys.executable, ROOT / "scripts/demo/make_creature.py", blend)
    run(sys.executable, ROOT / "relume_bake.py", blend, "--", "bake", "--out", bake, "--samples", args.samples)
    run(*RELUME, "relight", bake, "--out", out / "own_lights.exr")
    for name, lights in (("evening", EVENING), ("night", NIGHT)):
        file = out / f"{name}.json"
        file.write_text(json.dumps({"format": "relume-lights", "version": 1, "name": name, "lights": lights}))
        run(*RELUME, "relight", bake, "--out", out / f"{name}.exr", "--lights", file)
    write_overview(out)


def run(*words):
    """Runs a command with its progress on this terminal."""
    subprocess.run([str(word) for word in words], check=True)


if __name__ == "__main__":
    main()
