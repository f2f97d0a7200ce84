"""Error of lights' pictures by crossings of a bake's segments and by connection to its vertices, at equal samples.

Runs `relume-estimators` (`cargo build --release -p relume-bench`) on scene files, keeps its records in
`docs/bench/quality.json`, and writes the page beside it. Blender exports scene files:
`relume_bake.py SHOT.blend -- export --out SHOT.scene --resolution 144x81`.
"""

import argparse
import datetime
import json
import os
import subprocess
import tempfile
from pathlib import Path

from markdown import rows

ROOT = Path(__file__).resolve().parents[2]
RECORDS = ROOT / "docs/bench/quality.json"
TEXT = """# Quality of a light's picture

Made by `scripts/bench/estimators.py` from `quality.json`. A sphere stands at random on a segment of the paths. Its
radius is a share of half the diagonal of what the paths reach. *Crossings* count the segments that meet the light.
*Connection* sends shadow rays from vertices of the same paths, and counts crossings for smooth gloss and glass.
Close to large lights both count, each by its share (`rust/gather/src/balance.rs`).

The reference is the mean of two bakes of {reference} paths in all, guided towards the light, connected and denoised.
Its own PSNR is that of one half against the other; a PSNR near it says no more than that. Figures are means over
lights, PSNR in dB after Reinhard's curve. Seconds are those of one light's sum where paths and vertices are there
already, on {cores} shared cores.{loaded}

{table}

## Shadow rays

Made by `scripts/bench/estimators.py SCENE --shadow-rays`: vertices of all bounces connected to the middle of a small
sphere that they face, on one thread. The same rays through the trees alone bound that from above.

{rays}

## Proxies

Made by `scripts/bench/proxies.py`. *Crossings* are the denoised sum of the bake that the proxy learned from, of {paths}
paths. The reference is of {proxy_reference} paths, connected and denoised. Seconds of training are those of each
thread's processor. Means are over unseen lights of all sizes that were learned.

{proxies}
"""
PICTURES = ["crossings", "denoised", "connection", "denoised", "reference's own"]
PROXY_HEAD = ["scene", "light", "network", "s of training", "proxy", "SMAPE", "crossings", "SMAPE", "MB of its file"]
SPEED = "shadow_rays_per_second"
RAYS_HEAD = ["scene", "connections, millions a second", "bare rays, millions a second", "share"]
HEAD = ["scene", "radius", "paths", *PICTURES, "s by crossings", "s by connection"]


def parse_arguments():
    """Options of a run; what is unknown goes to the program."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", type=Path, help="scene files; without any, only the page is written")
    parser.add_argument("--program", type=Path, default=ROOT / "target/release/relume-estimators")
    parser.add_argument("--reference", type=int, default=1024, help="paths per pixel of the reference")
    parser.add_argument("--shadow-rays", action="store_true", help="measure the speed of shadow rays alone")
    return parser.parse_known_args()


def measured(scene, args, more):
    """Records of a scene."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "records.json"
        command = [args.program, scene, "--out", out, "--reference", args.reference, *more]
        if args.shadow_rays:
            command.append("--shadow-rays")
        subprocess.run([str(word) for word in command], check=True)
        records = json.loads(out.read_text())
    about = {"device": f"CPU, {os.cpu_count()} cores", "date": datetime.date.today().isoformat()}
    if not args.shadow_rays:
        about["reference_samples"] = args.reference
    return [record | about for record in records]


def page(records):
    """The page of kept records."""
    trainings = [record for record in records if "train_seconds" in record]
    rays = [record for record in records if SPEED in record]
    records = [record for record in records if "psnr" in record and "train_seconds" not in record]
    groups = {}
    for record in records:
        groups.setdefault((record["scene"], record["light_size"], record["samples"]), []).append(record)

    def mean(group, name, **wanted):
        values = [one[name] for one in group if all(one[key] == value for key, value in wanted.items())]
        return sum(values) / len(values)

    lines = []
    for (scene, size, samples), group in groups.items():
        psnr = [
            f"{mean(group, 'psnr', estimator=estimator, denoised=denoised):.1f}"
            for estimator in ("crossings", "connection")
            for denoised in (False, True)
        ]
        seconds = [f"{mean(group, 'seconds', estimator=estimator):.2f}" for estimator in ("crossings", "connection")]
        own = f"{mean(group, 'reference_psnr'):.1f}"
        lines.append([f"{scene}, {group[0]['width']} wide", f"{size:.1%}", str(samples), *psnr, own, *seconds])
    reference = max(record["reference_samples"] for record in records)
    loaded = sorted({record["scene"] for record in records if "beside other work" in record["device"]})
    return TEXT.format(
        reference=reference,
        cores=records[0]["device"].split()[1],
        loaded=f"\nThose of {', '.join(loaded)} are too many: measured beside other work." if loaded else "",
        table=rows(HEAD, lines),
        paths=trainings[0]["samples"],
        proxy_reference=min(record["reference_samples"] for record in trainings),
        proxies=proxies_table(trainings),
        rays=rays_table(rays),
    )


def rays_table(records):
    """The table of speeds of shadow rays."""
    lines = []
    for record in sorted(records, key=lambda record: record["scene"]):
        ours, bare = record[SPEED], record["bare_rays_per_second"]
        lines.append([record["scene"], f"{ours / 1e6:.1f}", f"{bare / 1e6:.1f}", f"{ours / bare:.0%}"])
    return rows(RAYS_HEAD, lines)


def proxies_table(records):
    """The table of trainings, by the records of `scripts/bench/proxies.py`."""
    lines = []
    by_training = {}
    for record in records:
        key = (record["scene"], record["light_type"], record["network"], record["train_seconds"])
        by_training.setdefault(key, {})[record["estimator"]] = record
    for (scene, light, network, seconds), made in sorted(by_training.items()):
        proxy, crossings = made["proxy"], made["crossings"]
        figures = [
            f"{one[name]:{form}}" for one in (proxy, crossings) for name, form in (("psnr", ".1f"), ("smape", ".3f"))
        ]
        size = f"{proxy['proxy_bytes'] / 1e6:.2f}"
        lines.append([f"{scene}, {proxy['width']} wide", light, network, f"{seconds:g}", *figures, size])
    return rows(PROXY_HEAD, lines)


def keep(new, is_replaced):
    """Adds records to those that are kept, less the ones that they replace, and writes the page."""
    records = [record for record in json.loads(RECORDS.read_text()) if not is_replaced(record)] + new
    RECORDS.write_text(json.dumps(records, indent=1) + "\n")
    RECORDS.with_suffix(".md").write_text(page(records))


def main():
    """Measures scenes, keeps the records, writes the page."""
    args, more = parse_arguments()
    for scene in args.scenes:
        keep(
            measured(scene, args, more),
            lambda old, name=scene.stem: (
                old["scene"] == name and "train_seconds" not in old and (SPEED in old) == args.shadow_rays
            ),
        )
    keep([], lambda _: False)


if __name__ == "__main__":
    main()
