"""The demo: the whole chain on a small scene made by script, with the commands that a user has.

Makes a .blend, bakes it, trains a proxy, relights it under three lightings, finds a hidden light again from a picture,
and leaves pictures, `report.json` and `report.html` in the output folder.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SCENE = "demo"
RELUME = (sys.executable, "-m", "relume")

EVENING = [
    {
        "name": "Window",
        "radiance": [9.0, 4.2, 1.6],
        "shape": {
            "type": "quad",
            "center": [2.4, -0.6, 1.7],
            "edge_u": [0.0, -1.4, 0.0],
            "edge_v": [-0.35, 0.0, 1.3],
            "spread": 3.14159,
        },
    },
    {
        "name": "Candle",
        "radiance": [30.0, 12.0, 3.5],
        "shape": {"type": "sphere", "center": [-0.35, -0.75, 0.35], "radius": 0.09},
    },
]
NIGHT = [
    {
        "name": "Moon",
        "radiance": [1.6, 2.4, 4.5],
        "shape": {"type": "sun", "direction": [0.64, -0.48, 0.6], "half_angle": 0.2},
    },
    {
        "name": "Lantern",
        "radiance": [20.0, 9.0, 2.0],
        "shape": {"type": "sphere", "center": [0.75, 0.9, 1.75], "radius": 0.16},
    },
]
HIDDEN = {
    "name": "Hidden",
    "radiance": [14.0, 9.0, 5.0],
    "shape": {"type": "sphere", "center": [0.9, -0.9, 1.5], "radius": 0.25},
}


# How long the steps take beside each other, in no unit. The time of training itself is set by the user.
EFFORT = {
    "Make the scene": 2,
    "Bake": 27,
    "Train": 12,
    "Relight": 2,
    "Target picture": 2,
    "Find the hidden light": 24,
}
RELIGHTS = 4


class Remaining:
    """Estimates the time left for all steps from the time that the finished ones took."""

    def __init__(self, training_seconds):
        self.training = training_seconds
        self.effort_left = sum(EFFORT.values()) + (RELIGHTS - 1) * EFFORT["Relight"]
        self.effort_done, self.seconds_done = 0.0, 0.0

    def __str__(self):
        # Until something was measured, a unit of effort counts as a second.
        pace = self.seconds_done / self.effort_done if self.effort_done > 2 else 1.0
        return f"about {self.training + self.effort_left * pace:.0f} s left"

    def finished(self, title, seconds):
        """Takes a step off what is left."""
        if title == "Train":
            seconds -= self.training
            self.training = 0.0
        effort = EFFORT[title.split(":")[0]]
        self.effort_left -= effort
        self.effort_done += effort
        self.seconds_done += seconds


class Demo:
    """Runs the commands one after another and keeps what they measured."""

    def __init__(self, out, samples, seconds):
        self.out, self.samples, self.seconds = out, samples, seconds
        self.bake = out / "bake"
        self.records = []
        self.start = time.monotonic()
        self.remaining = Remaining(seconds)

    def note(self, name, value, unit):
        """Keeps one figure."""
        self.records.append({"scene": SCENE, "name": name, "value": value, "unit": unit})

    def command(self, title, *words):
        """Runs a command with its progress on this terminal."""
        print(f"\n== {title} ({time.monotonic() - self.start:.0f} s so far, {self.remaining})", flush=True)
        start = time.monotonic()
        subprocess.run([str(word) for word in words], check=True)
        seconds = time.monotonic() - start
        self.note(f"{title}: wall time", round(seconds, 1), "s")
        self.remaining.finished(title, seconds)

    def lights(self, name, lights):
        """Writes a light set and returns its file."""
        path = self.out / f"{name}.json"
        path.write_text(json.dumps({"format": "relume-lights", "version": 1, "name": name, "lights": lights}, indent=1))
        return path

    def relight(self, name, *options):
        """Relights the bake into name.exr and name.png."""
        self.command(f"Relight: {name}", *RELUME, "relight", self.bake, "--out", self.out / f"{name}.exr", *options)

    def run(self):
        """Everything, in order."""
        blend = self.out / "demo.blend"
        self.command("Make the scene", sys.executable, ROOT / "scripts/demo/make_scene.py", blend)
        self.command(
            "Bake",
            sys.executable,
            ROOT / "relume_bake.py",
            blend,
            "--",
            "bake",
            "--out",
            self.bake,
            "--samples",
            self.samples,
        )
        self.command("Train", *RELUME, "train", self.bake, "--type", "sphere", "--seconds", self.seconds)
        self.relight("own_lights")
        self.relight("evening", "--lights", self.lights("evening", EVENING))
        self.relight("night", "--lights", self.lights("night", NIGHT))
        self.find_hidden_light()
        write_overview(self.out)
        self.write_reports()

    def find_hidden_light(self):
        """Makes a target with a light that the solver does not know, solves, and compares."""
        hidden = self.lights("hidden", [HIDDEN])
        self.command(
            "Target picture", *RELUME, "gather", self.bake, "--lights", hidden, "--out", self.out / "target.exr"
        )
        found_file = self.out / "found.json"
        self.command(
            "Find the hidden light",
            *RELUME,
            "optimise",
            self.bake,
            "--target",
            self.out / "target.exr",
            "--out",
            found_file,
        )
        self.relight("found", "--with", "gather", "--lights", found_file)
        found = json.loads(found_file.read_text())["lights"][0]
        wanted, got = HIDDEN["shape"], found["shape"]
        error = sum((a - b) ** 2 for a, b in zip(wanted["center"], got["center"], strict=True)) ** 0.5
        self.note("Hidden light: position error", round(error, 4), "m")
        self.note("Hidden light: radius, true", wanted["radius"], "m")
        self.note("Hidden light: radius, found", round(got["radius"], 4), "m")
        for channel, true, solved in zip("RGB", power(HIDDEN), power(found), strict=True):
            self.note(f"Hidden light: power {channel}, found / true", round(solved / true, 4), "")

    def write_reports(self):
        """report.json and report.html."""
        measured = json.loads((self.bake / "proxy_sphere.json").read_text())
        for maker in ("proxy", "gather", "gather_denoised"):
            for metric, value in measured[maker].items():
                self.note(f"Held-out lights, {maker}: {metric}", round(value, 4), "dB" if metric == "psnr" else "")
        self.note("Whole demo: wall time", round(time.monotonic() - self.start, 1), "s")
        (self.out / "report.json").write_text(json.dumps(self.records, indent=1))
        (self.out / "report.html").write_text(html(self.records))
        for record in self.records:
            print(f"{record['name']:45} {record['value']} {record['unit']}")
        print(f"\nPictures and report: {self.out / 'report.html'}")


def write_overview(out):
    """overview.png: the three lightings in a folder side by side."""
    pictures = [Image.open(out / f"{name}.png").convert("RGB") for name in ("own_lights", "evening", "night")]
    width, height = pictures[0].size
    overview = Image.new("RGB", (len(pictures) * width, height))
    for column, picture in enumerate(pictures):
        overview.paste(picture, (column * width, 0))
    overview.save(out / "overview.png")


def power(light):
    """Radiance times projected area, RGB: what a small light's picture depends on."""
    return [value * light["shape"]["radius"] ** 2 for value in light["radiance"]]


def html(records):
    """The one-page report."""
    pictures = [
        ("own_lights", "The file's own lights"),
        ("evening", "Evening"),
        ("night", "Night"),
        ("target", "Target, made by a hidden light"),
        ("found", "The light that was found"),
    ]
    figures = "".join(
        f"<figure><img src='{name}.png'><figcaption>{title}</figcaption></figure>" for name, title in pictures
    )
    rows = "".join(f"<tr><td>{r['name']}</td><td>{r['value']} {r['unit']}</td></tr>" for r in records)
    return f"""<!doctype html><meta charset="utf-8"><title>Relume demo</title>
<style>body {{ font: 15px sans-serif; background: #181818; color: #ddd; margin: 2em }}
figure {{ display: inline-block; margin: 0 1em 1em 0 }} td {{ padding: 0.15em 1.5em 0.15em 0 }}</style>
<h1>Relume demo</h1><p>One bake without lights; every picture below was made from it.</p>
{figures}<h2>Figures</h2><table>{rows}</table>"""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--seconds", type=float, default=75.0, help="training time")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    Demo(args.out.resolve(), args.samples, args.seconds).run()


if __name__ == "__main__":
    main()
