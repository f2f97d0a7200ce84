"""The paper's figure 9: one sphere light found again, Relume beside Mitsuba 3's gradients, error over time.

Both start from the same light, with the same bounds, on this machine and after each other, each with its own number of
steps: what is compared is how far they get in how many seconds. Each fits a target of its own renderer, since kitchen's
materials are simplified for Mitsuba: Relume a Cycles render, Mitsuba a Mitsuba render.
"""

import json
import subprocess
import sys
from pathlib import Path
from statistics import median

from problem import FREE, parameter_error, random_spheres, shape_of, sphere, spheres_of
from records import GENERAL, general

from addon.core.metrics import psnr_reinhard

HERE = Path(__file__).resolve().parent
SCENES = ("cornell_box", "kitchen")
FRACTION = 0.05
BOUNCES = 8
TARGET_SEED, RESULT_SEED = 1, 3
RELUME, MITSUBA = "relume", "mitsuba"


def run(shot, records, args):
    """All runs of one scene that are not measured yet, first Relume's, then Mitsuba's."""
    methods = [RELUME] + ([MITSUBA] if args.peers else [])
    keys = [(method, number) for method in methods for number in range(args.runs)]
    cells = {key: settings(shot, args, *key) for key in keys}
    wanted = {key: cell for key, cell in cells.items() if not records.has(cell)}
    if not wanted:
        return
    shot.open(bare=True)
    space = shot.judge.space()
    peer = Mitsuba(shot, args) if any(method == MITSUBA for method, _ in wanted) else None
    for (method, number), cell in wanted.items():
        seed = 5000 + 2 * number
        target, start = (random_spheres(shot.judge, space, seed + part, 1) for part in (0, 1))
        shot.judge.set(lights=target, only=True)
        picture = shot.picture(TARGET_SEED)
        if method == MITSUBA:
            name, trajectory = peer.solve(target, start, space, seed)
        else:
            name, trajectory = relume(shot, start, space, picture, seed)
        points = [shape_of(start[0]), *(point[1] for point in trajectory)]
        errors = [parameter_error([point], [shape_of(target[0])], space) for point in points]
        times = [0.0, *(point[0] for point in trajectory)]
        shot.judge.set(lights=[sphere(start[0]["name"], *points[-1])], only=True)
        record = cell | {
            "method": name,
            "threads": args.threads,
            "psnr": psnr_reinhard(shot.picture(RESULT_SEED), picture),
            "seconds": times[-1],
            "bake_seconds": None if method == MITSUBA else shot.bake_seconds,
            "parameter_error": errors[-1],
            "trajectory": [[round(t, 3), round(error, 5)] for t, error in zip(times, errors, strict=True)],
        }
        records.add(record)
        print(line(record), flush=True)
    if peer:
        peer.close()


def settings(shot, args, method, number):
    """Fields that a run's record is known by."""
    same = {"table": "9", "scene": shot.name, "lights": 1, "run": number, "starts": 1} | general(args)
    if method == MITSUBA:
        return same | {"pixel_fraction": 1.0, "through": MITSUBA, "steps": args.peer_steps}
    return same | {"pixel_fraction": FRACTION, "through": args.through}


def relume(shot, start, space, picture, seed):
    """(method, [(seconds, light)]) of Relume."""
    shot.judge.set(lights=start, only=True)
    lights = shot.judge.describe()
    request = {
        "lights": lights,
        "world": [0, 0, 0],
        "static": [0, 0, 0],
        "free": {lights[0]["name"]: FREE},
        "bounds": space,
        "goals": [{"goal": "target", "image": "target"}],
        "keep_rest": 0.0,
        "starts": 1,
        "remove": False,
        "pixel_fraction": FRACTION,
        "seed": seed,
    }
    previews = []
    result = shot.solve(request, {"target": picture}, lambda *preview: previews.append(preview))
    trajectory = [(seconds, spheres_of(found)[0]) for seconds, found in previews if spheres_of(found)]
    trajectory.append((result["seconds"], spheres_of(result["lights"])[0]))
    return f"relume {result['through']}", trajectory


class Mitsuba:
    """Mitsuba's solver, in its own environment, on a scene written from the .blend."""

    def __init__(self, shot, args):
        folder = shot.folder / "mitsuba"
        xml = folder / "scene.xml"
        if not xml.exists():
            folder.mkdir(parents=True, exist_ok=True)
            command = [sys.executable, HERE.parent / "mitsuba_scene.py", shot.blend, folder]
            subprocess.run([str(word) for word in command], check=True, stdout=subprocess.DEVNULL)
        size = ("--width", shot.resolution["width"], "--height", shot.resolution["height"])
        options = ("--bounces", BOUNCES, "--steps", args.peer_steps, "--threads", args.threads)
        command = [args.peers, HERE / "mitsuba_solve.py", xml, *size, *options]
        self.process = subprocess.Popen(
            [str(word) for word in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def solve(self, target, start, space, seed):
        """(method, [(seconds, light)])."""
        lights = {}
        for name, light in (("target", target[0]), ("start", start[0])):
            lights[name] = dict(zip(("center", "radius", "radiance"), shape_of(light), strict=True))
        self.process.stdin.write(json.dumps(lights | {"space": space, "seed": seed}) + "\n")
        self.process.stdin.flush()
        for answer in self.process.stdout:
            if answer.startswith("{"):
                found = json.loads(answer)
                return found["method"], [(point[0], tuple(point[1:])) for point in found["trajectory"]]
        raise RuntimeError("Mitsuba ended; its message is above")

    def close(self):
        """Ends the process."""
        self.process.stdin.close()
        self.process.wait()


def line(record):
    """One run as it is done."""
    text = "  {scene:12} run {run}: error {first:.3f} -> {parameter_error:.3f}, {psnr:.1f} dB, {seconds:.1f} s {method}"
    return text.format(first=record["trajectory"][0][1], **record)


def problem(record):
    """Values that two methods must have in common to be compared."""
    return tuple(record[key] for key in ("run", "threads", *GENERAL) if key != "steps")


def reached(trajectory, error):
    """Seconds until the error is at most this for the first time; None if never."""
    return next((seconds for seconds, value in trajectory if value <= error), None)


def show(records):
    """Medians over the runs, where there are both over those that both have; how much sooner Relume is where Mitsuba
    is at its best."""
    print("\nFigure 9: one light from random starts, medians")
    found = records.select(table="9")
    for scene in sorted({record["scene"] for record in found}):
        by_method = {}
        for record in found:
            if record["scene"] == scene:
                method = (record["through"] == MITSUBA, record["method"], record["steps"], record["through"])
                by_method.setdefault(method, {})[problem(record)] = record
        ours = [some for (is_peer, *_), some in sorted(by_method.items()) if not is_peer]
        theirs = [some for (is_peer, *_), some in sorted(by_method.items()) if is_peer]
        pairs = [(mine, peer) for mine in ours for peer in theirs if mine.keys() & peer.keys()]
        for mine, peer in pairs:
            runs = sorted(mine.keys() & peer.keys())
            compare([mine[run] for run in runs], [peer[run] for run in runs])
        if not pairs:
            for some in ours + theirs:
                row(list(some.values()))


def row(records):
    """Prints the medians of one method."""
    first, number = records[0], len(records)
    error, seconds, psnr = (median(record[key] for record in records) for key in ("parameter_error", "seconds", "psnr"))
    name = f"{first['scene']:12} {first['method']:28} {first['steps']:3} steps {number:3} runs"
    threads = {0: "all cores", 1: "one thread"}.get(first["threads"], f"{first['threads']} threads")
    print(f"{name}  error {error:.4f}  {psnr:5.1f} dB  {seconds:7.1f} s, {threads}")


def compare(ours, theirs):
    """Prints the medians of two methods over the same runs, and how much sooner Relume is where Mitsuba is at its best,
    median of the runs; 0 if it never gets there."""
    row(ours)
    row(theirs)
    pairs = list(zip(ours, theirs, strict=True))
    lower = sum(mine["parameter_error"] < peer["parameter_error"] for mine, peer in pairs)
    bake = median(mine["bake_seconds"] for mine in ours)
    alone, with_bake = (median(how_much_sooner(*pair, spent) for pair in pairs) for spent in (0.0, bake))
    best = f"Mitsuba's best error of {theirs[0]['steps']} steps {alone:.1f} x sooner"
    whole = f"{with_bake:.1f} x where the bake of {bake:.0f} s, which serves every solve, is counted"
    print(f"{ours[0]['scene']:12} Relume: lower final error in {lower} of {len(pairs)} runs; {best}, {whole}")


def how_much_sooner(mine, peer, spent):
    """How many times sooner one gets to the best error of the other, with seconds spent before; 0 if never."""
    best = min(error for _, error in peer["trajectory"])
    sooner, later = reached(mine["trajectory"], best), reached(peer["trajectory"], best)
    return later / max(spent + sooner, 1e-3) if sooner is not None else 0.0
