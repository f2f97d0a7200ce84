"""Benchmarks: this machine's limits, and peers measured in the same run. Writes `out/bench.json`.

Runs in a Python with `bpy` and `relume`; the peers (Mitsuba, PyTorch) live in an environment of their own.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
WIDTH, BOUNCES, FEW, MANY = 320, 6, 16, 64
NETWORKS = ("64/4", "128/8", "256/8")
GIB = 2**30


def record(name, value, unit, **more):
    """A flat record with every field."""
    fields = dict.fromkeys(("peer", "peer_value", "ratio", "limit", "share_of_limit"))
    return {"name": name, "value": value, "unit": unit} | fields | more


def against(name, value, unit, peer, peer_value):
    """A record with a peer."""
    return record(name, value, unit, peer=peer, peer_value=peer_value, ratio=value / peer_value)


def last_json(*words, **environment):
    """The JSON of the last line that a command prints."""
    command = [str(word) for word in words]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment})
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def kernels():
    """Gather, networks and the closed box, from the program's own bench."""
    return last_json(sys.executable, "-m", "relume", "--json", "bench")[-1]["records"]


def networks(peers, records):
    """Inference and training against PyTorch, one thread each."""
    rows = last_json(peers, HERE / "peer_torch.py", *NETWORKS, OMP_NUM_THREADS="1")
    for row in rows:
        for task in ("inference", "training"):
            ours = next((r for r in records if r["name"].startswith(f"{task} reference {row['network']},")), None)
            if ours:
                ours.update(peer=row["peer"], peer_value=row[task], ratio=ours["value"] / row[task])


def bake(blend, size, samples, folder):
    """Bakes; returns its report and the peak memory of the process in bytes."""
    width, height = size
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    report = last_json(
        sys.executable,
        ROOT / "relume_bake.py",
        blend,
        "--",
        "bake",
        "--json",
        "--out",
        folder,
        "--samples",
        samples,
        "--bounces",
        BOUNCES,
        "--resolution",
        f"{width}x{height}",
    )[-1]
    return report, max(before, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss) * 1024


def rendering(name, size, peers):
    """Paths per second of one scene: ours against Cycles and, where the scene exists for it, Mitsuba."""
    blend = SCENES / f"{name}.blend"
    with tempfile.TemporaryDirectory() as folder:
        few, _ = bake(blend, size, FEW, f"{folder}/few")
        many, memory = bake(blend, size, MANY, f"{folder}/many")
    value = (many["paths"] - few["paths"]) / (many["seconds"] - few["seconds"])
    sizes = ("--width", size[0], "--height", size[1], "--samples", MANY, "--bounces", BOUNCES)
    cycles = last_json(sys.executable, HERE / "peer_cycles.py", blend, *sizes)[-1]
    label = f"trace {name}, {size[0]}x{size[1]}, {BOUNCES} bounces"
    rows = [against(label, value, "paths/s", cycles["peer"], cycles["paths_per_second"])]
    xml = SCENES / "mitsuba" / name / "scene.xml"
    if xml.exists():
        mitsuba = last_json(peers, HERE / "peer_mitsuba.py", xml, *sizes)[-1]
        rows.append(against(label, value, "paths/s", mitsuba["peer"], mitsuba["paths_per_second"]))
    else:
        print(f"bench: {name} has no Mitsuba scene; compared with Cycles only")
    return [*rows, record(f"peak memory of a bake so far, {name}", memory / GIB, "GiB")]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "out")
    parser.add_argument("--peers", type=Path, required=True, help="python with mitsuba and torch")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    records = kernels()
    networks(args.peers, records)
    if SCENES.is_dir():
        for name, size in (("kitchen", (320, 180)), ("modern_hall", (240, 240)), ("coffee_maker", (192, 240))):
            records += rendering(name, size, args.peers)
    else:
        print(f"bench: the scenes are not in {SCENES}; set RELUME_SCENES to compare renderers")
    (args.out / "bench.json").write_text(json.dumps(records, indent=1))
    for r in records:
        peer = f"  {r['ratio']:.2f} x {r['peer']}" if r["ratio"] else ""
        share = f"  {100 * r['share_of_limit']:.0f} % of the limit" if r["share_of_limit"] else ""
        print(f"{r['name']:56} {r['value']:12.4g} {r['unit']:10}{peer}{share}")


if __name__ == "__main__":
    main()
