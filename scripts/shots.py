"""Real shots from end to end, with the commands that a user has: bake, train, relight with the file's own lights moved.

For each .blend: its own lights, the same lights moved and tinted by gathering, and by the trained network alone. Leaves
EXRs, PNGs and one overview in the output folder, for a person to look at: `make shots`.
"""

import argparse
import json
import os
import random
import subprocess
import sys
from pathlib import Path

import relume
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))


def run(*words):
    """One command, on this terminal."""
    print("$", *words, flush=True)
    subprocess.run([str(word) for word in words], check=True)


def moved(lights, rng):
    """The lights, each up to half a metre away and in another colour."""
    for light in lights:
        shape = light["shape"]
        if "center" in shape:
            shape["center"] = [value + rng.uniform(-0.5, 0.5) for value in shape["center"]]
        light["radiance"] = [value * rng.uniform(0.3, 1.2) for value in light["radiance"]]
    return lights


def shot(blend, out, args):
    """All of one .blend; returns its pictures."""
    bake = out / "bake"
    command = (sys.executable, "-m", "relume")
    size = ("--resolution-percentage", args.percentage)
    run(sys.executable, ROOT / "relume_bake.py", blend, "--", "bake", "--out", bake, "--samples", args.samples, *size)
    lights = json.loads((bake / "lights.json").read_text())
    for kind in sorted({kind for light in lights["lights"] if (kind := relume.Light(light).kind)}):
        run(*command, "train", bake, "--type", kind, "--seconds", args.seconds, "--all-paths")
    lights["lights"] = moved(lights["lights"], random.Random(args.seed))
    (out / "moved.json").write_text(json.dumps(lights, indent=1))
    run(*command, "relight", bake, "--out", out / "own.exr")
    run(*command, "relight", bake, "--out", out / "moved.exr", "--lights", out / "moved.json")
    proxy = ("--with", "proxy", "--lights", out / "moved.json")
    run(*command, "relight", bake, "--out", out / "moved_by_proxy.exr", *proxy)
    return [out / f"{name}.png" for name in ("own", "moved", "moved_by_proxy")]


def overview(rows, path):
    """One picture of all, a shot a row."""
    rows = [[Image.open(picture).convert("RGBA") for picture in row] for row in rows]
    sheet = Image.new("RGB", (max(3 * row[0].width for row in rows), sum(row[0].height for row in rows)))
    y = 0
    for row in rows:
        for column, picture in enumerate(row):
            sheet.paste(picture, (column * picture.width, y), mask=picture)
        y += row[0].height
    sheet.save(path)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("blends", nargs="*", type=Path, help="default: kitchen and modern_hall of the real scenes")
    parser.add_argument("--out", type=Path, default=ROOT / "out/shots")
    parser.add_argument("--percentage", type=int, default=25, help="of the files' resolution")
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--seconds", type=float, default=180.0, help="training of each type of light")
    parser.add_argument("--seed", type=int, default=1, help="of the lights' moves")
    args = parser.parse_args()
    blends = args.blends or [SCENES / f"{name}.blend" for name in ("kitchen", "modern_hall")]
    missing = [str(blend) for blend in blends if not blend.exists()]
    if missing:
        sys.exit(f"shots: not there: {', '.join(missing)}; name .blend files, or set RELUME_SCENES")
    rows = []
    for blend in blends:
        out = args.out.resolve() / blend.stem
        out.mkdir(parents=True, exist_ok=True)
        rows.append(shot(blend, out, args))
        overview(rows, args.out / "overview.png")
    print(f"Pictures: {args.out / 'overview.png'}")


if __name__ == "__main__":
    main()
