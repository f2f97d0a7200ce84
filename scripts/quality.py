"""Proxy quality: both networks at equal training time, on lights never trained on, against the denoised gather of an
independent bake; and what gathering from the bake that was trained on reaches on the same lights.

Training time is processor time per thread, so that both networks get the same whatever else the machine does; on a GPU
it is time by the clock. Needs the real scenes (RELUME_SCENES or ../shared/scenes). Bakes are kept in the output folder
and resumed, so that a stopped run goes on.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
WIDTH = 256  # across a picture if not asked otherwise, pixels: a reference bake takes gigabytes
BOUNCES = 6  # the paper's six segments a path and one more


def resolution_percentage(blend, width):
    """What makes the picture of a .blend so many pixels wide, or up to a hundredth of it less."""
    code = (
        f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blend)!r}); "
        "print('WIDTH', bpy.context.scene.render.resolution_x)"
    )
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    whole = next(int(line.split()[1]) for line in output.splitlines() if line.startswith("WIDTH"))
    return 100 * width // whole


def bake(blend, out, width, samples, seed, threads):
    """Bakes so many pixels wide, or finishes a bake."""
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
        resolution_percentage(blend, width),
        "--threads",
        threads,
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
        command = [sys.executable, "-m", "relume", "--json", "--threads", self.args.threads, *words]
        output = subprocess.run([str(word) for word in command], check=True, stdout=subprocess.PIPE, text=True).stdout
        line = json.loads(output.splitlines()[-1])
        return line.get("result", line)

    def scene(self, name):
        """All of one scene."""
        width, threads = self.args.width, self.args.threads
        folder = self.args.out / ("quality" if width == WIDTH else f"quality-{width}") / name
        blend = SCENES / f"{name}.blend"
        bake(blend, folder / "train", width, self.args.samples, 1, threads)
        bake(blend, folder / "reference", width, self.args.reference_samples, 2, threads)
        for kind in self.args.types:
            trained = [
                self.train(folder, kind, network, seconds)
                for network in self.args.networks
                for seconds in self.args.seconds
            ]
            self.measure(folder, kind, trained)
        if not self.args.keep:
            shutil.rmtree(folder / "reference")

    def train(self, folder, kind, network, seconds):
        """One training: the file of its proxy and its record as far as it is known."""
        out = folder / f"{kind}_{network}_{seconds:g}s"
        options = ["--type", kind, "--network", network, "--seconds", seconds, "--all-paths"]
        if self.args.device == "cpu":
            options.append("--processor-time")
        report = self.relume("--device", self.args.device, "train", folder / "train", *options, "--out", out)
        record = {"network": network, "train_seconds": seconds, "samples": report["samples"]}
        return out / f"proxy_{kind}.safetensors", record

    def measure(self, folder, kind, trained):
        """All proxies of one kind, and gathering from the bake that they were trained on, on the same lights."""
        options = ("--reference", folder / "reference", "--gather", folder / "train")
        pictures = ("--pictures", folder / f"{kind}_pictures")
        lights = ("--lights", self.args.lights, "--seed", 11)
        found = self.relume("evaluate", *(path for path, _ in trained), *options, *pictures, *lights)
        for (_, record), errors in zip(trained, found["proxies"], strict=True):
            self.record(folder.name, kind, record, errors)
        for key in ("gather", "gather_denoised", "reference_noise"):
            record = {"network": key, "train_seconds": 0, "samples": 0}
            self.record(folder.name, kind, record, found[key])

    def record(self, scene, kind, record, errors):
        """Keeps, prints and writes a record."""
        errors = {key: round(errors[key], 4) for key in ("psnr", "smape", "ssim", "flip")}
        record = {"scene": scene, "width": self.args.width, "light_type": kind} | record | errors
        self.records.append(record)
        print(ROW.format(**record), flush=True)
        (self.args.out / "quality.json").write_text(json.dumps(self.records, indent=1))


ROW = "{scene:12} {light_type:7} {network:16} {train_seconds:5g} s {psnr:6.2f} dB {smape:.4f} {ssim:.4f} {flip:.4f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    parser.add_argument("--scenes", nargs="+", default=["cornell_box", "kitchen", "modern_hall"])
    parser.add_argument("--width", type=int, default=WIDTH, help="pixels across; the paper's pictures have about 885")
    parser.add_argument("--types", nargs="+", default=["sphere", "quad"])
    parser.add_argument("--seconds", nargs="+", type=float, default=[8.0, 24.0, 72.0], help="training times")
    parser.add_argument("--samples", type=int, default=512, help="samples of the bake that is trained on")
    parser.add_argument("--reference-samples", type=int, default=4096)
    parser.add_argument("--lights", type=int, default=100)
    parser.add_argument("--device", default="cpu", help="what trains: cpu, gpu or a part of a GPU's name")
    parser.add_argument("--networks", nargs="+", default=["fast", "reference"])
    parser.add_argument("--threads", type=int, default=0, help="0 for one a core")
    parser.add_argument("--keep", action="store_true", help="keep the reference bakes (13 GB each)")
    args = parser.parse_args()
    if not SCENES.is_dir():
        sys.exit(f"quality: the scenes are not in {SCENES}; set RELUME_SCENES")
    args.out.mkdir(parents=True, exist_ok=True)
    quality = Quality(args)
    print("scene, light type, network, training time, PSNR, SMAPE, SSIM, FLIP")
    for name in args.scenes:
        quality.scene(name)


if __name__ == "__main__":
    main()
