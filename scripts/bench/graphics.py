"""Benchmarks of a GPU. Runs `scripts/gpu-check`, or takes the figures that one made elsewhere (--from); writes
`out/bench-gpu.json`; with --keep also a file of this machine under `docs/bench`, and the tables over all machines
there. With --quality proxies are trained on the real scenes as well, and measured beside the paper's table 2;
--quality-from takes what `scripts/gpu-check quality` found of them elsewhere.
"""

import argparse
import json
import shlex
import subprocess
import sys
from pathlib import Path
from statistics import mean

from markdown import rows

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "docs/bench"
GOALS = json.loads((ROOT / "rust/bench/src/goals.json").read_text())
"""Goals of an H200, beside the paper's figures; `relume-bench` puts the same beside its records."""
QUALITY = {"psnr": "dB", "smape": "", "ssim": "", "flip": ""}
"""Measures of the paper's table 2, and units."""
TESTS_UNFINISHED = 3
"""Exit code of `scripts/gpu-check` where nothing failed and all figures are there, but not all tests had time."""


def measure(device, software, out):
    """The records of a run of `scripts/gpu-check` here."""
    command = [ROOT / "scripts/gpu-check", "--device", device, "--out", out, *(["--software"] if software else [])]
    (out / "bench-gpu.json").unlink(missing_ok=True)
    status = subprocess.run([str(word) for word in command], check=False).returncode
    if status == TESTS_UNFINISHED:
        print("bench: the time was up before all tests had run (see above); the figures are complete and are kept")
    elif status:
        sys.exit("bench: see above; the figures that there are can be taken with --from")
    return json.loads((out / "bench-gpu.json").read_text())


def goal_of(name):
    """The goal of a figure."""
    return next((goal for goal in GOALS if any(name.startswith(begin) for begin in goal["names"])), None)


def measure_quality(device, options, out):
    """Results of `scripts/quality.py` where this device trains."""
    command = [sys.executable, ROOT / "scripts/quality.py", "--device", device, "--out", out, *shlex.split(options)]
    subprocess.run([str(word) for word in command], check=True)
    return json.loads((out / "quality.json").read_text())


def quality_records(found, adapter):
    """Means over scenes of what `scripts/quality.py` found, and how noisy it was what it compared with."""
    groups = {}
    for record in found:
        if record["train_seconds"]:
            what = "the {light_type} proxy {network}, {train_seconds:g} s of training, {width} wide"
        elif record["network"] == "reference_noise":
            what = "the {light_type} reference of {reference_samples} samples before it was denoised, {width} wide"
        else:
            continue
        groups.setdefault(what.format(**record), []).append(record)
    return [quality_record(name, key, group, adapter) for name, group in groups.items() for key in QUALITY]


def quality_record(name, key, group, adapter):
    """The mean of a measure; of proxies beside the paper's, which trained for an hour."""
    name = f"{key.upper()} of {name}, {', '.join(record['scene'] for record in group)}"
    goal, value = goal_of(name), mean(record[key] for record in group)
    paper = next(goal["paper"] for goal in GOALS if goal["names"][0].startswith(f"{key.upper()} of "))
    is_proxy = group[0]["train_seconds"] > 0
    return {
        "name": name,
        "value": value,
        "unit": QUALITY[key],
        "peer": "the paper, table 2" if is_proxy else None,
        "peer_value": paper if is_proxy else None,
        "ratio": value / paper if is_proxy else None,
        "limit": None,
        "share_of_limit": None,
        "adapter": adapter,
        "date": group[0]["date"],
    } | ({"goal": goal["goal"]} if goal else {})


def line(record):
    """A record for people."""
    share, peer, goal = record["share_of_limit"], record["peer"], record.get("goal")
    by = f" by {record['limit_by']}" if "limit_by" in record else ""
    limit = f", {share:.0%} of {record['limit']:.4g}{by}" if share is not None else ""
    wanted = f", goal {goal:.4g}" if goal is not None else ""
    beside = f" ({peer}: {record['peer_value']:.4g}, ratio {record['ratio']:.3g})" if peer else ""
    return f"{record['value']:.4g} {record['unit']}".rstrip() + limit + wanted + beside


def figure_of(goal, records):
    """Figure that a machine has reached of a goal: the first of its figures that there is."""
    found = (record for name in goal["names"] for record in records if record["name"].startswith(name))
    record = next(found, None)
    return f"{record['value']:.4g} {record['unit']}".rstrip() if record else "not measured"


def goals_table(machines):
    """A row for each goal, a column for each machine with a graphics card."""

    def number(goal, key):
        bound = "at least " if key == "goal" and goal.get("at_least") else ""
        return "" if goal[key] is None else f"{bound}{goal[key]:g} {goal['unit']}".rstrip()

    def limit(goal):
        return f"{number(goal, 'limit')} ({goal['limit_by']})" if goal["limit"] else goal["limit_by"]

    head = ["", "goal on an H200", "the paper, RTX 5090", "limit of an H200", *(machines or ["any card"])]
    lines = [
        [goal["what"], number(goal, "goal"), number(goal, "paper"), limit(goal)]
        + ([figure_of(goal, records) for records in machines.values()] or ["not measured"])
        for goal in GOALS
    ]
    return rows(head, lines)


def table(folder):
    """Table of `docs/bench/README.md`: goals, and a row for each figure, a column for each kept machine."""
    files = [path for path in sorted(folder.glob("*.json")) if path.stem not in ("cases", "house")]
    machines = {path.stem: json.loads(path.read_text()) for path in files}
    cards = {name: records for name, records in machines.items() if "llvmpipe" not in records[0]["adapter"]}
    names = dict.fromkeys(record["name"] for records in machines.values() for record in records)
    heads = [f"{machine} ({records[0]['adapter']}, {records[0]['date']})" for machine, records in machines.items()]
    lines = [
        [name, *(next((line(r) for r in records if r["name"] == name), "") for records in machines.values())]
        for name in names
    ]
    return TEXT.format(
        state=NO_CARD if not cards else f"Graphics cards so far: {', '.join(cards)}.",
        goals=goals_table(cards),
        all=rows(["", *heads], lines),
    )


NO_CARD = """**No graphics card, an H200 or any other, has run this yet.** None of the goals is shown to be reached.
What stands below was measured on a software driver, which shows that everything runs, and nothing about speed."""

TEXT = """# GPU benchmarks

{state}

Made by `make bench-gpu BENCH_GPU="--keep MACHINE"` from the files beside it. A machine that has nothing but its driver:
`scripts/gpu-check build` here, copy `build/gpu-check.tar.xz`, unpack it there, `./gpu-check`; then here
`python3 scripts/bench/graphics.py --from bench-gpu.json --keep MACHINE`. Training to the paper's quality needs the
scenes and Blender's Python to read them:
`make bench-gpu BENCH_GPU='--keep MACHINE --quality "--seconds 300 --types sphere --networks fast --width 885"'`. On a
machine without Blender `gpu-check quality` measures it (TESTING.md); `--quality-from` takes what it found.
PSNR, SMAPE, SSIM and FLIP are of pictures as wide as their names say. The paper's are about 885 x 500; without
`--width` they are 256 wide, which is another problem than the paper's: fewer pixels for the same training, less detail.

## Goals

Limits here are arithmetic with what others measured of H200s: 4.3 TB/s, 790 TFLOP/s of 16-bit matrices; and 67 TFLOP/s
of 32-bit floats by its data sheet. Each figure further below has the limit that was measured in the same run.

{goals}

## All figures

{all}
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="gpu", help="gpu for the best, or a part of its name")
    parser.add_argument("--software", action="store_true", help="take a software driver if there is no card")
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE", help="take the bench-gpu.json of gpu-check")
    parser.add_argument("--keep", metavar="MACHINE", help="name of this machine in docs/bench")
    parser.add_argument("--quality", metavar="OPTIONS", help='of scripts/quality.py: "--seconds 300 --types sphere"')
    parser.add_argument(
        "--quality-from", type=Path, nargs="+", default=[], metavar="FILE", help="quality.json of gpu-check"
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.source:
        records = json.loads(args.source.read_text())
    else:
        records = measure(args.device, args.software, args.out)
    found = [record for file in args.quality_from for record in json.loads(file.read_text())]
    if args.quality is not None:
        found += measure_quality(args.device, args.quality, args.out)
    quality = quality_records(found, records[0]["adapter"])
    records = list({record["name"]: record for record in records + quality}.values())
    (args.out / "bench-gpu.json").write_text(json.dumps(records, indent=1))
    for record in records:
        print(f"{record['name']:60} {line(record)}")
    if args.keep:
        keep(records, args.keep, KEPT)


def keep(records, machine, folder):
    """Keeps the figures of a machine, and makes the tables anew."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{machine}.json").write_text(json.dumps(records, indent=1) + "\n")
    (folder / "README.md").write_text(table(folder))


if __name__ == "__main__":
    main()
