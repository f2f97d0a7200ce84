"""Proxy quality: both networks at equal training time, on lights never trained on, against an independent gather.

Needs the real scenes (RELUME_SCENES or ../shared/scenes). Bakes are kept in the output folder and resumed, so that a
stopped run goes on.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
WIDTH = 256
BOUNCES = 6  # the paper's six segments a path and one more


def resolution_percentage(blend):
    """What makes the picture of a .blend WIDTH pixels wide."""
    code = (
        f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blend)!r}); "
        "print('WIDTH', bpy.context.scene.render.resolution_x)"
    )
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    width = next(int(line.split()[1]) for line in output.splitlines() if line.startswith("WIDTH"))
    return 100 * WIDTH // width


def bake(blend, out, samples, seed):
    """Bakes, or finishes a bake."""
    command = [
        sys.executable,
        ROOT / "relume_bake.py",
        blend,
        "--",
        "bake",
        "--out",
        out,
        "--samples",
        samples,
        "--seed",
        seed,
        "--bounces",
        BOUNCES,
        "--resolution-percentage",
        resolution_percentage(blend),
    ]
    if (out / "manifest.json").exists():
        command.append("--resume")
    subprocess.run([str(word) for word in command], check=True)


class Quality:
    """Trains and measures; keeps the records."""

    def __init__(self, args):
        self.args = args
        self.records = []

    def relume(self, *words):
        """The result of a command: the last JSON line that it printed."""
        command = [str(word) for word in (sys.executable, "-m", "relume", "--json", *words)]
        output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        return json.loads(output.splitlines()[-1])

    def scene(self, name):
        """All of one scene."""
        folder = self.args.out / "quality" / name
        train, reference = folder / "train", folder / "reference"
        bake(SCENES / f"{name}.blend", train, self.args.samples, 1)
        bake(SCENES / f"{name}.blend", reference, self.args.reference_samples, 2)
        for kind in self.args.types:
            for network in ("fast", "reference"):
                for seconds in self.args.seconds:
                    self.network(name, train, reference, kind, network, seconds)

    def network(self, name, train, reference, kind, network, seconds):
        """One training of one network."""
        out = train.parent / f"{kind}_{network}_{seconds:g}s"
        self.relume(
            "train", train, "--type", kind, "--network", network, "--seconds", seconds, "--all-paths", "--out", out
        )
        mean = self.relume(
            "evaluate",
            out / f"proxy_{kind}.safetensors",
            "--reference",
            reference,
            "--lights",
            self.args.lights,
            "--seed",
            11,
        )
        result = mean.get("result", mean)
        record = {"scene": name, "light_type": kind, "network": network, "train_seconds": seconds}
        self.records.append(record | {key: round(result[key], 4) for key in ("psnr", "smape", "ssim", "flip")})
        print(self.records[-1], flush=True)
        (self.args.out / "quality.json").write_text(json.dumps(self.records, indent=1))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    parser.add_argument("--scenes", nargs="+", default=["cornell_box", "kitchen", "modern_hall"])
    parser.add_argument("--types", nargs="+", default=["sphere", "quad"])
    parser.add_argument("--seconds", nargs="+", type=float, default=[60.0, 240.0, 900.0], help="training times")
    parser.add_argument("--samples", type=int, default=512, help="samples of the bake that is trained on")
    parser.add_argument("--reference-samples", type=int, default=4096)
    parser.add_argument("--lights", type=int, default=100)
    args = parser.parse_args()
    if not SCENES.is_dir():
        sys.exit(f"quality: the scenes are not in {SCENES}; set RELUME_SCENES")
    args.out.mkdir(parents=True, exist_ok=True)
    quality = Quality(args)
    for name in args.scenes:
        quality.scene(name)


if __name__ == "__main__":
    main()
