"""Proxy quality: both networks at equal training time, on lights never trained on, against the denoised gather of an
independent bake; and what gathering from the bake that was trained on reaches on the same lights.

Training time is processor time per thread, so that both networks get the same whatever else the machine does; on a GPU
it is time by the clock. Scenes are .blend files in RELUME_SCENES (or ../shared/scenes), or scene files, which need
neither Blender nor more of Python than its own library. Bakes are kept in the output folder and resumed, so that a
stopped run goes on.
"""

import argparse
import datetime
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
WIDTH = 256  # across a picture if not asked otherwise, pixels: a reference bake takes gigabytes
EQUAL = 100.0  # dB that `relume evaluate` says of equal pictures
BOUNCES = 6  # the paper's six segments a path and one more


def resolution(blend, width):
    """Options that make the picture of a .blend so many pixels wide, in its own shape."""
    code = (
        f"import bpy; bpy.ops.wm.open_mainfile(filepath={str(blend)!r}); render = bpy.context.scene.render; "
        "print('SIZE', render.resolution_x, render.resolution_y)"
    )
    output = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    whole = next(line.split()[1:] for line in output.splitlines() if line.startswith("SIZE"))
    return "--resolution", f"{width}x{round(width * int(whole[1]) / int(whole[0]))}"


def command_on(blend, words):
    """Runs a command of the add-on on a .blend."""
    command = [sys.executable, ROOT / "relume_bake.py", blend, "--", *words]
    subprocess.run([str(word) for word in command], check=True)


def export(names, width, folder):
    """Writes scene files so many pixels wide."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        blend = SCENES / f"{name}.blend"
        command_on(blend, ["export", "--out", folder / f"{name}.scene", *resolution(blend, width)])


class Quality:
    """Trains and measures; keeps the records."""

    def __init__(self, args):
        self.args = args
        self.records = []

    def relume(self, *words):
        """The result of a command: the last JSON line that it printed."""
        program = [self.args.program] if self.args.program else [sys.executable, "-m", "relume"]
        command = [*program, "--json", "--threads", self.args.threads, *words]
        output = subprocess.run([str(word) for word in command], check=True, stdout=subprocess.PIPE, text=True).stdout
        line = json.loads(output.splitlines()[-1])
        return line.get("result", line)

    def bake(self, scene, out, samples, seed):
        """Bakes a scene of that name or a scene file, or finishes a bake."""
        width = self.args.width
        options = ["--out", out, "--samples", samples, "--seed", seed, "--bounces", BOUNCES]
        options += ["--resume"] * (out / "manifest.json").exists()
        if Path(scene).suffix == ".scene":
            found = self.relume("trace", scene, *options)["width"]
            if found != width:
                sys.exit(f"quality: {scene} is {found} pixels wide, not {width}; export it anew or say --width {found}")
        else:
            blend = SCENES / f"{scene}.blend"
            command_on(blend, ["bake", *options, *resolution(blend, width), "--threads", self.args.threads])

    def scene(self, scene):
        """All of one scene."""
        width = self.args.width
        folder = self.args.out / ("quality" if width == WIDTH else f"quality-{width}") / Path(scene).stem
        self.bake(scene, folder / "train", self.args.samples, 1)
        self.bake(scene, folder / "reference", self.args.reference_samples, 2)
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
        if found["reference_noise"]["psnr"] >= EQUAL:
            sys.exit("quality: the reference was not denoised: this relume finds no Open Image Denoise")
        for (_, record), errors in zip(trained, found["proxies"], strict=True):
            self.record(folder.name, kind, record, errors)
        for key in ("gather", "gather_denoised", "reference_noise"):
            record = {"network": key, "train_seconds": 0, "samples": 0}
            self.record(folder.name, kind, record, found[key])

    def record(self, scene, kind, record, errors):
        """Keeps, prints and writes a record."""
        errors = {key: round(errors[key], 4) for key in ("psnr", "smape", "ssim", "flip")}
        about = {"scene": scene, "width": self.args.width, "reference_samples": self.args.reference_samples}
        date = datetime.datetime.now(datetime.UTC).date().isoformat()
        record = about | {"light_type": kind} | record | errors | {"date": date}
        self.records.append(record)
        print(ROW.format(**record), flush=True)
        (self.args.out / "quality.json").write_text(json.dumps(self.records, indent=1))


ROW = "{scene:12} {light_type:7} {network:16} {train_seconds:5g} s {psnr:6.2f} dB {smape:.4f} {ssim:.4f} {flip:.4f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    parser.add_argument("--scenes", nargs="+", default=["cornell_box", "kitchen", "modern_hall"], help="or scene files")
    parser.add_argument("--export", type=Path, metavar="FOLDER", help="only write scene files of the scenes there")
    parser.add_argument("--program", type=Path, help="relume; without it the Python package")
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
    if not SCENES.is_dir() and not all(Path(scene).suffix == ".scene" for scene in args.scenes):
        sys.exit(f"quality: the scenes are not in {SCENES}; set RELUME_SCENES")
    if args.export:
        return export(args.scenes, args.width, args.export)
    args.out.mkdir(parents=True, exist_ok=True)
    quality = Quality(args)
    print("scene, light type, network, training time, PSNR, SMAPE, SSIM, FLIP")
    for scene in args.scenes:
        quality.scene(scene)
    return None


if __name__ == "__main__":
    main()
