"""Error of proxies after so many seconds of training, beside the denoised sum of the same bake's crossings.

Runs `relume` on scene files of about 256 pixels (`relume_bake.py SHOT.blend -- export --out SHOT.scene --resolution
256x144`), keeps its records in `docs/bench/quality.json`, and writes the page beside it. Seconds are those of each
thread's processor, so that other load on the machine changes little.
"""

import argparse
import datetime
import json
import os
import subprocess
import tempfile
from pathlib import Path

from estimators import ROOT, keep

SEED = 7
"""Seed of the reference."""


def parse_arguments():
    """Options of a run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="+", type=Path, help="scene files")
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/relume")
    parser.add_argument("--samples", type=int, default=64, help="paths per pixel of the bake")
    parser.add_argument("--reference", type=int, default=256, help="paths per pixel of the reference")
    parser.add_argument("--seconds", type=float, nargs="+", default=[72.0], help="of each training")
    parser.add_argument("--types", nargs="+", default=["sphere", "quad"])
    parser.add_argument("--networks", nargs="+", default=["fast"])
    parser.add_argument("--lights", type=int, default=16)
    return parser.parse_args()


def relume(args, *words):
    """Runs a command of the program; its result."""
    command = [args.program, "--device", "cpu", "--json", *words]
    run = subprocess.run([str(word) for word in command], check=True, capture_output=True, text=True)
    return json.loads(run.stdout.splitlines()[-1])


def records_of(scene, args, folder):
    """Records of all trainings on a scene."""
    bake, reference = folder / "bake", folder / "reference"
    relume(args, "trace", scene, "--out", bake, "--samples", args.samples)
    relume(args, "--seed", SEED, "trace", scene, "--out", reference, "--samples", args.reference)
    width = json.loads((bake / "manifest.json").read_text())["width"]
    records = []
    for kind in args.types:
        for network in args.networks:
            for seconds in args.seconds:
                out = folder / f"{kind}_{network}_{seconds:g}"
                words = ("--type", kind, "--network", network, "--seconds", seconds, "--processor-time", "--all-paths")
                relume(args, "train", bake, "--out", out, *words)
                proxy = out / f"proxy_{kind}.safetensors"
                words = ("--reference", reference, "--gather", bake, "--lights", args.lights)
                found = relume(args, "evaluate", proxy, *words)
                about = {
                    "scene": scene.stem,
                    "width": width,
                    "light_type": kind,
                    "samples": args.samples,
                    "device": f"CPU, {os.cpu_count()} cores",
                    "date": datetime.date.today().isoformat(),
                    "reference_samples": args.reference,
                    "train_seconds": seconds,
                    "network": network,
                }
                made = {
                    "proxy": (found["proxies"][0], {"proxy_bytes": proxy.stat().st_size}),
                    "crossings": (found["gather_denoised"], {"denoised": True}),
                }
                records += [about | {"estimator": name} | error | more for name, (error, more) in made.items()]
                print(json.dumps(records[-2:]), flush=True)
    return records


def main():
    """Measures scenes, keeps the records, writes the page."""
    args = parse_arguments()
    for scene in args.scenes:
        with tempfile.TemporaryDirectory() as folder:
            new = records_of(scene, args, Path(folder))
        done = {(one["scene"], one["light_type"], one["network"], one["train_seconds"]) for one in new}
        keep(
            new,
            lambda old, done=done: (
                (old["scene"], old["light_type"], old.get("network"), old.get("train_seconds")) in done
            ),
        )


if __name__ == "__main__":
    main()
