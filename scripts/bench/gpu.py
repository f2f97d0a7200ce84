"""Benchmarks of a GPU. Writes `out/bench-gpu.json`; with --keep also a file of this machine under `docs/bench`, and the
table over all machines there."""

import argparse
import datetime
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
KEPT = ROOT / "docs/bench"


def measure(device):
    """The records of `relume bench` on a device, dated."""
    command = [sys.executable, "-m", "relume", "--json", "--device", device, "bench"]
    output = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    result = json.loads(output.splitlines()[-1])
    date = datetime.datetime.now(datetime.UTC).date().isoformat()
    return [record | {"date": date} for record in result["records"]]


def line(record):
    """A record for people."""
    share = record["share_of_limit"]
    limit = f", {share:.0%} of the limit" if share is not None else ""
    return f"{record['value']:.4g} {record['unit']}{limit}"


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
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    args = parser.parse_args()
    records = measure(args.device)
    args.out.mkdir(parents=True, exist_ok=True)
    (args.out / "bench-gpu.json").write_text(json.dumps(records, indent=1))
    for record in records:
        print(f"{record['name']:60} {line(record)}")
    if args.keep:
        KEPT.mkdir(parents=True, exist_ok=True)
        (KEPT / f"{args.keep}.json").write_text(json.dumps(records, indent=1) + "\n")
        (KEPT / "README.md").write_text(table(KEPT))


if __name__ == "__main__":
    main()
