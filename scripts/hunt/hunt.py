"""Random scenes against Cycles, from a seed: `make hunt`.

A round is one random thing: a graph of values, a mixture of closures, a world, a lamp, a transform, settings of a
scene. It fails if Blender crashes, if Relume raises anything but its own refusal, gives values that are not finite, or
another picture than Cycles without a warning that names what is in it. Each failing round is printed with the command
that plays it alone, and what is left of it when all is gone that does not matter; its file and the records go to
`out/hunt`. A world takes longer than the others: Relume renders each in a Blender of its own.
"""

import argparse
import json
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PICTURES = {"graphs": 48, "closures": 24, "worlds": 1, "lamps": 1, "transforms": 1, "settings": 1}
"""Rounds that a picture of each kind shows."""

SECONDS = 600
"""How long a picture may take before it counts as a hang."""


class Hunt(NamedTuple):
    """One kind in one version."""

    version: str
    kind: str
    seed: int
    without: tuple[str, ...] = ()
    minimise: bool = False

    @property
    def folder(self):
        """Where its files, its log and its records are."""
        return ROOT / "out/hunt" / self.version

    def command(self, number):
        """Command line that plays a round alone."""
        left_out = f" --without {' '.join(self.without)}" if self.without else ""
        words = f"--version {self.version} --kinds {self.kind} --seed {self.seed} --round {number}"
        return f'make hunt HUNT="{words}{left_out}"'


def play(hunt, numbers):
    """Faults of some rounds. What was in a picture when Blender ended is played in halves, down to a single round.
    That Cycles ended it is shown, but is no fault."""
    groups = {}
    for number in numbers:
        groups.setdefault(number // PICTURES[hunt.kind], []).append(number)
    waiting, faults = list(groups.values()), []
    while waiting:
        played, found, ended = play_pictures(hunt, waiting)
        faults += found
        waiting = waiting[played:]
        if waiting and ended:
            seen = {fault["round"] for fault in found}
            broken = [number for number in waiting.pop(0) if number not in seen]
            if len(broken) == 1:
                crash = {"round": broken[0], "fault": "crash", "said": ended}
                show(hunt, crash)
                faults += [] if ended.startswith("Cycles") else [crash]
            elif broken:
                half = len(broken) // 2
                waiting = [broken[:half], broken[half:], *waiting]
    return faults


def play_pictures(hunt, pictures):
    """How many pictures a process played, their faults, and how it ended if it did so before its time."""
    hunt.folder.mkdir(parents=True, exist_ok=True)
    command = [ROOT / f".venv-{hunt.version}/bin/python", ROOT / "scripts/hunt/batch.py", "--kind", hunt.kind]
    command += ["--seed", str(hunt.seed), "--pictures", json.dumps(pictures), "--folder", hunt.folder]
    command += [*(["--minimise"] if hunt.minimise else []), "--without", *hunt.without]
    log = hunt.folder / "log.txt"
    with log.open("w", buffering=1) as out:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=out, text=True, cwd=ROOT)
        records = list(told(hunt, process, out))
        code = process.wait()
    if code > 0:
        sys.exit(f"hunt: {last_line(log)} ({log})")
    faults = [record["fault"] for record in records if "fault" in record]
    at = next((record["at"] for record in reversed(records) if "at" in record), "Blender")
    ended = f"{at}: signal {-code}" + (f" after {SECONDS} s" if code == -signal.SIGKILL else "") if code else ""
    return sum("played" in record for record in records), faults, ended


def told(hunt, process, log):
    """Lines of a process as they come; it is ended where it says nothing for too long."""
    watch = None
    for line in process.stdout:
        if not line.startswith("HUNT "):
            log.write(line)
            continue
        if watch:
            watch.cancel()
        watch = threading.Timer(SECONDS, process.kill)
        watch.start()
        record = json.loads(line.removeprefix("HUNT "))
        if "fault" in record:
            show(hunt, record["fault"])
        yield record
    if watch:
        watch.cancel()


def last_line(path):
    """The last line of a log that says something."""
    return ([line for line in path.read_text().splitlines() if line.strip()] or ["no output"])[-1]


def show(hunt, fault):
    """Prints a failing round, and how to play it alone."""
    figures = {key: fault[key] for key in ("block", "ours", "cycles", "error", "said") if key in fault}
    print(f"FAULT {hunt.kind} {fault['round']} in {hunt.version}: {fault['fault']} {figures}")
    for line in [hunt.command(fault["round"]), *(f"  {line}" for line in fault.get("minimal", []))]:
        print(f"  {line}")
    sys.stdout.flush()


def versions_here():
    """The oldest and the newest version that have an environment here."""
    found = {
        tuple(map(int, p.parents[1].name.removeprefix(".venv-").split("."))) for p in ROOT.glob(".venv-?.?/bin/python")
    }
    return [f"{major}.{minor}" for major, minor in (min(found), max(found))]


def main():
    """Plays rounds of each kind in each version, and prints a line of each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", type=lambda text: text.split(","), default=list(PICTURES))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=48, help="of each kind")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--round", type=int, help="a single one")
    parser.add_argument("--version", nargs="+", default=versions_here(), dest="versions")
    parser.add_argument("--no-minimise", action="store_true", help="print failing rounds as they are")
    parser.add_argument(
        "--without", nargs="+", default=[], help="what trees are to hold none of: names of `trees.CHANCE`"
    )
    args = parser.parse_args()
    unknown = set(args.kinds) - set(PICTURES)
    if unknown:
        sys.exit(f"hunt: no kind {', '.join(sorted(unknown))}; kinds are {', '.join(PICTURES)}")
    numbers = range(args.first, args.first + args.rounds) if args.round is None else [args.round]
    lines = []
    for version in args.versions:
        for kind in args.kinds:
            hunt = Hunt(version, kind, args.seed, tuple(args.without), not args.no_minimise)
            faults = play(hunt, numbers)
            (hunt.folder / f"{kind}-{args.seed}.json").write_text(json.dumps(faults, indent=1))
            lines.append(f"{version} {kind:<11} seed {args.seed}: {len(numbers)} rounds, {len(faults)} failed")
            print(lines[-1], flush=True)
    print("\n".join(["", *lines]))
    return any(not line.endswith(", 0 failed") for line in lines)


if __name__ == "__main__":
    sys.exit(main())
