"""Benchmarks of a GPU. Writes `out/bench-gpu.json`; with --keep also a file of this machine under `docs/bench`, and the
table over all machines there. With --quality proxies are trained on the real scenes as well, and measured beside the
paper's table 2.
"""

import argparse
import datetime
import json
import shlex
import subprocess
import sys
from pathlib import Path
from statistics import mean

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "docs/bench"
PAPER = {"psnr": (41.07, "dB"), "smape": (0.0263, ""), "ssim": (0.9885, ""), "flip": (0.1014, "")}
"""Quality of the paper's full configuration (table 2), and units."""


def measure(device):
    """The records of `relume bench` on a device."""
    command = [sys.executable, "-m", "relume", "--json", "--device", device, "bench"]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(output.splitlines()[-1])["records"]


def measure_quality(device, options, out, adapter):
    """Means over scenes of what `scripts/quality.py` finds where this device trains."""
    command = [sys.executable, ROOT / "scripts/quality.py", "--device", device, "--out", out, *shlex.split(options)]
    subprocess.run([str(word) for word in command], check=True)
    groups = {}
    for record in json.loads((out / "quality.json").read_text()):
        if record["train_seconds"]:
            name = "{light_type} proxy {network}, {train_seconds:g} s of training".format(**record)
            groups.setdefault(name, []).append(record)
    general = {"peer": "paper, table 2", "limit": None, "share_of_limit": None, "adapter": adapter}
    records = []
    for name, group in groups.items():
        scenes = ", ".join(record["scene"] for record in group)
        for key, (paper, unit) in PAPER.items():
            value = mean(record[key] for record in group)
            own = {"name": f"{name}, {scenes}: {key.upper()}", "value": value, "unit": unit}
            records.append(own | {"peer_value": paper, "ratio": value / paper} | general)
    return records


def line(record):
    """A record for people."""
    share, peer = record["share_of_limit"], record["peer"]
    limit = f", {share:.0%} of the limit" if share is not None else ""
    beside = f" ({peer}: {record['peer_value']:.4g})" if peer else ""
    return f"{record['value']:.4g} {record['unit']}".rstrip() + limit + beside


def table(folder):
    """Markdown: a row for each figure, a column for each kept machine."""
    machines = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}
    names = dict.fromkeys(record["name"] for records in machines.values() for record in records)
    heads = [f"{machine} ({records[0]['adapter']}, {records[0]['date']})" for machine, records in machines.items()]
    rows = [["", *heads], ["---"] * (len(heads) + 1)]
    for name in names:
        cells = [next((line(r) for r in records if r["name"] == name), "") for records in machines.values()]
        rows.append([name, *cells])
    lines = "\n".join(f"| {' | '.join(row)} |" for row in rows)
    made_by = 'Made by `make bench-gpu BENCH_GPU="--keep MACHINE"` from the files beside it.'
    return f"# GPU benchmarks\n\n{made_by}\n\n{lines}\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="gpu", help="gpu for the best, or a part of its name")
    parser.add_argument("--keep", metavar="MACHINE", help="name of this machine in docs/bench")
    parser.add_argument("--quality", metavar="OPTIONS", help='of scripts/quality.py: "--seconds 300 --types sphere"')
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    records = measure(args.device)
    if args.quality is not None:
        records += measure_quality(args.device, args.quality, args.out, records[0]["adapter"])
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    records = [record | {"date": date} for record in records]
    (args.out / "bench-gpu.json").write_text(json.dumps(records, indent=1))
    for record in records:
        print(f"{record['name']:60} {line(record)}")
    if args.keep:
        KEPT.mkdir(parents=True, exist_ok=True)
        (KEPT / f"{args.keep}.json").write_text(json.dumps(records, indent=1) + "\n")
        (KEPT / "README.md").write_text(table(KEPT))


if __name__ == "__main__":
    main()
