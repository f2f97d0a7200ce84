"""Benchmarks: this machine's limits, and peers measured in the same run. Writes `out/bench.json`.

Runs in a Python with `bpy` and `relume`; the peers (Mitsuba, PyTorch) live in an environment of their own.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
PROGRAM = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "release/relume-bench"
"""Built by `make bench`, which also sets `OIDN_DIR`."""
SCENES = Path(os.environ.get("RELUME_SCENES", ROOT.parent / "shared/scenes"))
BOUNCES, FEW, MANY, MOST = 6, 16, 64, 256
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
    """Tracer, gather and networks, from `relume-bench`."""
    libraries = f"{os.environ['OIDN_DIR']}/lib"
    return last_json(PROGRAM, "--json", "--quiet", "--device", "cpu", LD_LIBRARY_PATH=libraries)[-1]["records"]


def networks(peers, records):
    """Inference and training against PyTorch, one thread each."""
    rows = last_json(peers, HERE / "peer_torch.py", *NETWORKS, OMP_NUM_THREADS="1")
    for row in rows:
        for task in ("inference", "training"):
            ours = next((r for r in records if r["name"].startswith(f"{task} reference {row['network']},")), None)
            if ours:
                ours.update(peer=row["peer"], peer_value=row[task], ratio=ours["value"] / row[task])


def bake(blend, size, samples, folder):
    """Bakes in a process of its own; returns its report and the peak of its memory in bytes."""
    options = ("--samples", samples, "--bounces", BOUNCES, "--resolution", f"{size[0]}x{size[1]}")
    words = (sys.executable, ROOT / "relume_bake.py", blend, "--", "bake", "--json", "--out", folder, *options)
    process = subprocess.Popen([str(word) for word in words], stdout=subprocess.PIPE, text=True)
    lines = [json.loads(line) for line in process.stdout if line.startswith("{")]
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    return lines[-1], usage.ru_maxrss * 1024


def rendering(name, size, peers):
    """Paths per second of one scene against Cycles and Mitsuba, and peak memory by the number of samples."""
    blend = SCENES / f"{name}.blend"
    with tempfile.TemporaryDirectory() as folder:
        _, scene = bake(blend, (1, 1), 1, f"{folder}/scene")
        runs = [bake(blend, size, samples, f"{folder}/{samples}") for samples in (FEW, MANY, MOST)]
    (few, _), (many, _), _ = runs
    value = (many["paths"] - few["paths"]) / (many["seconds"] - few["seconds"])
    sizes = ("--width", size[0], "--height", size[1], "--samples", MANY, "--bounces", BOUNCES)
    cycles = last_json(sys.executable, HERE / "peer_cycles.py", blend, *sizes)[-1]
    label = f"trace {name}, {size[0]}x{size[1]}, {BOUNCES} bounces"
    rows = [against(label, value, "paths/s", cycles["peer"], cycles["paths_per_second"])]
    mitsuba = mitsuba_paths(name, blend, sizes, peers)
    rows.append(against(label, value, "paths/s", mitsuba["peer"], mitsuba["paths_per_second"]))
    for report, memory in runs:
        limit = scene + GIB
        more = {"limit": limit / GIB, "share_of_limit": memory / limit}
        rows.append(record(f"peak memory of a bake, {name}, {report['samples']} samples", memory / GIB, "GiB", **more))
    return rows


def mitsuba_paths(name, blend, sizes, peers):
    """Mitsuba's speed on its own scene file, or on one made from the .blend with approximated materials."""
    xml = SCENES / "mitsuba" / name / "scene.xml"
    if xml.exists():
        return last_json(peers, HERE / "peer_mitsuba.py", xml, *sizes)[-1]
    with tempfile.TemporaryDirectory() as folder:
        xml = last_json(sys.executable, HERE / "mitsuba_scene.py", blend, folder)[-1]["scene"]
        found = last_json(peers, HERE / "peer_mitsuba.py", xml, *sizes)[-1]
    return found | {"peer": f"{found['peer']}, materials approximated"}


def live():
    """How soon an artist sees something, against the project's goals."""
    rows = last_json(sys.executable, HERE / "live.py", SCENES / "modern_hall.blend")[-1]["records"]
    records = []
    for row in rows:
        name, value, unit, goal = (row.pop(key) for key in ("name", "value", "unit", "goal"))
        found = against(name, value, unit, "the goal", goal) if goal else record(name, value, unit)
        records.append(found | row)
    return records


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
        records += live()
    else:
        print(f"bench: the scenes are not in {SCENES}; set RELUME_SCENES to compare renderers")
    (args.out / "bench.json").write_text(json.dumps(records, indent=1))
    for r in records:
        peer = f"  {r['ratio']:.2f} x {r['peer']}" if r["ratio"] else ""
        share = f"  {100 * r['share_of_limit']:.0f} % of the limit" if r["share_of_limit"] else ""
        print(f"{r['name']:56} {r['value']:12.4g} {r['unit']:10}{peer}{share}")


if __name__ == "__main__":
    main()
