"""Gather against Cycles on real scenes and on scenes of one feature, under random lights of all types: `make parity`.

Paths know no lights, so each scene is baked without lights, and every light set is only gathered. Both sides use the
file's bounce limits and pixel filter, no denoiser, no clamping. Each side makes two pictures with different seeds:
their means are compared, and the difference between the two shows each side's own noise.

A run replaces the records of its scenes and Blender version in `docs/bench/parity.json`, keeps the others, and writes
the page beside it anew. Runs in a Python with `bpy` and `relume`; `--version` passes it on to another Blender's.
"""

import argparse
import datetime
import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
import relume
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), *(str(ROOT / "scripts" / name) for name in ("parity", "hunt", "bench"))]

import blame  # noqa: E402
import compare  # noqa: E402
import cycles_reference  # noqa: E402
import features  # noqa: E402
import features.stage  # noqa: E402
import light_sets  # noqa: E402
import page  # noqa: E402
from addon.engine.reading.scene import load_scene  # noqa: E402
from addon.export import trace_settings  # noqa: E402

SCENES = ("cornell_box", "modern_hall", "coffee_maker", "classroom", "kitchen", "sponza")
MEDIAN_LIMIT, P95_LIMIT = 0.02, 0.08
MOST_BEYOND_NOISE = 0.01
"""Share of the blocks that may differ by more than noise explains; three standard errors are left by 0.3 %."""
FEATURE_SIZE = 64, 48
RECORDS = ROOT / "docs/bench/parity.json"
VERSION = f"{bpy.app.version[0]}.{bpy.app.version[1]}"


def open_scene(folder, name, pixels):
    """A scene with its own lights, ready for both renderers; a file in its own aspect with whole blocks across."""
    if name in features.SCENES:
        scene = features.stage.set_up(*FEATURE_SIZE)
        features.SCENES[name](scene)
        return scene
    bpy.ops.wm.open_mainfile(filepath=str(folder / f"{name}.blend"))
    scene = bpy.context.scene
    aspect = scene.render.resolution_x / scene.render.resolution_y
    width = round(math.sqrt(pixels * aspect) / compare.BLOCK) * compare.BLOCK
    cycles_reference.prepare(scene, width, round(width / aspect))
    return scene


def bake(scene, samples, folder, more):
    """Relighters of two independent bakes of half the samples each, with `more` settings; prints warnings."""
    exported, settings = load_scene(scene), trace_settings(scene, print)
    relighters = []
    for seed in (0, 1):
        job = relume.bake(exported, folder / str(seed), settings | more | {"samples": samples // 2, "seed": seed})
        report = job.wait(on_warning=lambda text: print(f"  warning: {text}"))
        print(f"  baked {report['segments'] / 1e6:.1f} M segments in {report['seconds']:.0f} s", flush=True)
        relighters.append(relume.Relighter(folder / str(seed), world_of=exported))
    return relighters


def write_pictures(folder, name, ours, cycles):
    """Both pictures as sRGB and their block difference, black 0 to white 2 P95_LIMIT."""
    exposure = 0.5 / max(float(np.median(cycles)), float(cycles.mean()) / 4, 1e-9)
    for label, image in (("relume", ours), ("cycles", cycles)):
        values = np.clip(image * exposure, 0, 1) ** (1 / 2.2)
        Image.fromarray((values * 255).astype(np.uint8)).save(folder / f"{name}_{label}.png")
    difference = np.clip(compare.block_difference(ours, cycles).mean(axis=-1) / (2 * P95_LIMIT), 0, 1)
    picture = np.kron((difference * 255).astype(np.uint8), np.ones((compare.BLOCK, compare.BLOCK), np.uint8))
    Image.fromarray(picture).save(folder / f"{name}_difference.png")


def light_sets_of(scene, count, are_small):
    """Seed of each light set while its lights are in the file: 0 for its own lights, if any, then random ones alone."""
    own = [obj for obj in scene.objects if obj.type == "LIGHT"]
    if own and not are_small:
        yield 0
    light_sets.remove(own)
    for seed in range(1, count + 1):
        lights = light_sets.add_light_set(scene, seed, are_small)
        yield seed
        light_sets.remove(lights)


def parity(scene, name, relighters, seed, args):
    """The record of the lights that are in the file now."""
    lights = load_scene(scene).lights()
    gathers = [relighter.relight(lights, maker="gather", denoise=False)["combined"] for relighter in relighters]
    start = time.perf_counter()
    renders = [cycles_reference.render(scene, args.cycles_samples // 2, 2 * seed + half) for half in (0, 1)]
    seconds = time.perf_counter() - start
    ours, cycles = np.mean(gathers, axis=0), np.mean(renders, axis=0)
    result, noise, gather_noise = (compare.summary(*pair) for pair in ((ours, cycles), renders, gathers))
    beyond_noise = compare.share_beyond_noise(gathers, renders)
    within = result["median"] <= MEDIAN_LIMIT and result["p95"] <= P95_LIMIT or beyond_noise <= MOST_BEYOND_NOISE
    write_pictures(args.out / "parity", f"{name}_{seed}_{VERSION}", ours, cycles)
    blamed = [] if within else blame.worst_materials(scene, gathers, renders)
    return {
        "scene": name,
        "version": VERSION,
        "date": datetime.date.today().isoformat(),
        "seed": seed,
        "own_lights": seed == 0,
        **result,
        "noise_median": noise["median"],
        "noise_p95": noise["p95"],
        "gather_noise_median": gather_noise["median"],
        "gather_noise_p95": gather_noise["p95"],
        "beyond_noise": beyond_noise,
        "samples": args.samples,
        "cycles_samples": args.cycles_samples,
        "cycles_seconds": seconds,
        "within_limits": within,
        "materials_to_blame": blamed,
    }


def keep(new, name):
    """Replaces the records of a scene in this Blender, and the page."""
    records = json.loads(RECORDS.read_text()) if RECORDS.exists() else []
    records = [record for record in records if (record["scene"], record["version"]) != (name, VERSION)] + new
    records.sort(key=lambda record: (record["scene"], [*map(int, record["version"].split("."))], record["seed"]))
    RECORDS.write_text(json.dumps(records, indent=1) + "\n")
    RECORDS.with_suffix(".md").write_text(page.text(records, MEDIAN_LIMIT, P95_LIMIT, MOST_BEYOND_NOISE))


def parse_arguments():
    """Options of a run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default_scenes = os.environ.get("RELUME_SCENES") or ROOT.parent / "shared" / "scenes"
    parser.add_argument("--folder", type=Path, default=default_scenes, help="where the files of real scenes are")
    parser.add_argument("--scenes", nargs="+", default=SCENES, help=f"files, or of these: {', '.join(features.SCENES)}")
    parser.add_argument("--features", action="store_true", help="all scenes of one feature")
    parser.add_argument("--version", help="Blender version whose environment runs it")
    parser.add_argument("--sets", type=int, default=4, help="light sets for each scene")
    parser.add_argument("--pixels", type=int, default=6400, help="about how many a picture of a file has")
    parser.add_argument("--samples", type=int, default=4096, help="gathered paths per pixel, of both bakes together")
    parser.add_argument("--cycles-samples", type=int, default=512, help="of the two Cycles renders together")
    parser.add_argument("--small", action="store_true", help="lights of 1 to 5 cm, and suns of half a degree, alone")
    parser.add_argument("--guiding", type=float, help="share of directions that look for lights; default: the tracer's")
    parser.add_argument("--out", type=Path, default=ROOT / "out", help="where the pictures go")
    args = parser.parse_args()
    if args.features:
        args.scenes = list(features.SCENES)
    return args


def main():
    """Compares every scene under every light set: a table, `docs/bench/parity.json` and pictures."""
    args = parse_arguments()
    if args.version and args.version != VERSION:
        python = ROOT / f".venv-{args.version}/bin/python"
        os.execv(python, [str(python), *sys.argv])
    files = [args.folder / f"{name}.blend" for name in args.scenes if name not in features.SCENES]
    missing = [path.stem for path in files if not path.exists()]
    if missing:
        sys.exit(f"parity: not in {args.folder}: {', '.join(missing)}; set RELUME_SCENES")
    (args.out / "parity").mkdir(parents=True, exist_ok=True)
    more = {} if args.guiding is None else {"guiding": args.guiding}
    missed = 0
    for name in args.scenes:
        print(name, flush=True)
        scene = open_scene(args.folder, name, args.pixels)
        name += " small" if args.small else ""
        with tempfile.TemporaryDirectory(prefix="relume-parity-") as baked:
            relighters = bake(scene, args.samples, Path(baked), more)
            records = []
            for seed in light_sets_of(scene, args.sets, args.small):
                records.append(parity(scene, name, relighters, seed, args))
                print(line(records[-1]), flush=True)
        keep(records, name)
        missed += sum(not record["within_limits"] for record in records)
    print(f"{missed} light sets missed median {MEDIAN_LIMIT:.0%} and p95 {P95_LIMIT:.0%}, and more than noise explains")


def line(record):
    """A row of the printed table."""
    verdict = "" if record["within_limits"] else "  MISSED: " + ", ".join(record["materials_to_blame"])
    lights = "own lights" if record["own_lights"] else f"set {record['seed']}"
    return (
        f"  {record['scene']:<13} {lights:<10}  median {record['median']:6.2%}  p95 {record['p95']:6.2%}  "
        f"mean {record['mean_ratio']:.4f}  noise of Cycles {record['noise_median']:6.2%} {record['noise_p95']:6.2%}"
        f"  of gather {record['gather_noise_median']:6.2%} {record['gather_noise_p95']:6.2%}"
        f"  beyond noise {record['beyond_noise']:6.2%}{verdict}"
    )


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender before 5.0 can crash at exit.
    os._exit(0)
