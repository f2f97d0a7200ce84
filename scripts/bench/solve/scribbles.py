"""Strokes with a known good answer: a hidden change of one or two lights, painted, solved for and judged by Cycles.

Run 0 makes one light one stop brighter; run 1 makes one a stop darker and moves another; further runs draw from both.
What the hidden change makes brighter, darker or leaves alone is painted, at 80 % of the change. Every light of the
file may change its strength, the ones of the hidden change also move. What is found is written into the file, which is
saved, opened again and rendered with the seed of the picture before. Files with fewer than two lights get seeded point
lights.
"""

import json
import math
import random
import tempfile
from pathlib import Path

import relume
import strokes
from problem import random_spheres
from records import general

SCENES = ("cornell_box", "kitchen", "modern_hall", "classroom", "coffee_maker", "sponza")
LEAST_LIGHTS = 2
LEAST_SHARE = 0.15
"""Of the picture; a light with less is not changed."""
MOVE = 0.12
"""Of the diagonal of what the camera sees."""
KEEP_LIMIT = 0.02
STARTS = 4
"""As the add-on has it."""
SEED = 1


def run(shot, records, args):
    """All runs of one scene that are not measured yet."""
    for number in range(args.runs):
        cell = settings(shot, args, number)
        if records.has(cell):
            continue
        shot.open(bare=False)
        record = cell | Shown(shot, number).measure()
        records.add(record)
        print(lines(record), flush=True)


def settings(shot, args, number):
    """What a run's record is known by."""
    same = {"table": "scribbles", "scene": shot.name, "run": number, "through": args.through} | general(args)
    return same | {"lights": None, "pixel_fraction": 0.05, "starts": STARTS}


class Shown:
    """A scene before and after its hidden change."""

    def __init__(self, shot, number):
        self.shot, self.rng = shot, random.Random(100 + number)
        self.space = shot.judge.space()
        self._add_lights()
        self.lights = shot.judge.describe()
        self.before = shot.picture(SEED)
        self.changed = self._hidden_change(number)
        self.goals = strokes.paint(self.before, shot.picture(SEED), self.rng)
        shot.judge.put_back()

    def _add_lights(self):
        missing = LEAST_LIGHTS - len(self.shot.judge.describe())
        if missing > 0:
            lights = random_spheres(self.shot.judge, self.space, 7, missing)
            level = self._static_level()
            self.shot.judge.set(lights=lights)
            shares = self._shares()
            for light in lights:
                light["energy"] *= 0.5 * level / max(shares[light["name"]], 1e-9)
            self.shot.judge.set(lights=lights)

    def _static_level(self):
        """Mean of the picture without any added lights."""
        relit = relume.Relighter(self.shot.folder).relight(maker="gather", denoise=False)
        return float(relit["combined"].mean())

    def _shares(self):
        """Mean of each light's own picture."""
        lights = json.dumps(self.shot.judge.light_set())
        relit = relume.Relighter(self.shot.folder).relight(lights, maker="gather", denoise=False)
        return {name: float(picture.mean()) for name, picture in relit["lights"].items()}

    def _hidden_change(self, number):
        """Changes lights that matter in the open file; their names."""
        shares = self._shares()
        total = sum(shares.values())
        able = sorted(name for name, share in shares.items() if share >= LEAST_SHARE * total)
        self.rng.shuffle(able)
        move = MOVE * math.dist(self.space["min"], self.space["max"])
        first, second = able[0], able[1 % len(able)]
        if number == 0 or number > 1 and self.rng.random() < 0.5:
            self.shot.judge.change(name=first, gain=2.0, move=[0.0, 0.0, 0.0])
            return [first]
        direction = [self.rng.gauss(0, 1) for _ in "xyz"]
        length = math.hypot(*direction)
        self.shot.judge.change(name=first, gain=0.5, move=[0.0, 0.0, 0.0])
        self.shot.judge.change(name=second, gain=1.0, move=[move * value / length for value in direction])
        return sorted({first, second})

    def request(self):
        """What `relume.solve` is asked for."""
        free = {light["name"]: ["strength"] for light in self.lights}
        free |= {name: ["strength", "position"] for name in self.changed if name in free}
        goals = [goal for goal, _ in self.goals]
        return {"lights": self.lights, "free": free, "goals": goals, "remove": False, "starts": STARTS, "seed": 0}

    def measure(self):
        """Solves, writes back, renders and measures each stroke."""
        if not self.goals:
            return {
                "strokes": [],
                "changed": self.changed,
                "psnr": None,
                "parameter_error": None,
                "seconds": 0.0,
                "method": "-",
                "note": "the hidden change shows nowhere",
            }
        result = self.shot.solve(self.request())
        judge = self.shot.judge
        judge.set(lights=result["blender"])
        judge.remove(names=result["removed"])
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "solved.blend")
            judge.save(path=path)
            judge.open(blend=path, size=self.shot.size)
            after = self.shot.picture(SEED)
        said = {row["number"]: row for row in result["report"]}
        found = [
            verdict(goal, known, strokes.change(self.before, after, goal["where"]), said.get(number))
            for number, (goal, known) in enumerate(self.goals)
        ]
        return {
            "strokes": found,
            "changed": self.changed,
            "psnr": None,
            "parameter_error": None,
            "seconds": result["seconds"],
            "method": f"relume {result['through']}",
        }


def verdict(goal, known, ratio, said):
    """One stroke: asked, done by the hidden change, by what was found (Cycles), and by what was found as it is said."""
    if goal["goal"] == "keep":
        values = {"asked": 0.0, "known": known - 1.0, "reached": ratio - 1.0, "met": abs(ratio - 1.0) < KEEP_LIMIT}
    else:
        sign = 1.0 if goal["goal"] == "brighter" else -1.0
        reached = sign * math.log2(ratio)
        values = {"asked": goal["stops"], "known": sign * math.log2(known), "reached": reached}
        values["met"] = reached >= goal["stops"]
    said_reached = None if said is None else said["reached"] * (-1.0 if goal["goal"] == "darker" else 1.0)
    return {"goal": goal["goal"], **values, "said": said_reached}


def lines(record):
    """A line for each stroke."""
    texts = []
    for found in record["strokes"]:
        unit = "(relative)" if found["goal"] == "keep" else "stops"
        said = "-" if found["said"] is None else f"{found['said']:.3f}"
        texts.append(
            f"  {record['scene']:12} run {record['run']}  {found['goal']:8} asked {found['asked']:6.3f}"
            f"  known answer {found['known']:6.3f}  reached {found['reached']:6.3f} {unit:10} (the solver says {said})"
            f"  {'met' if found['met'] else 'MISSED'}"
        )
    return "\n".join(texts) or f"  {record['scene']:12} run {record['run']}  {record['note']}"


def show(records):
    """All strokes, and how many are met."""
    found = sorted(records.select(table="scribbles"), key=lambda record: (record["scene"], record["run"]))
    print("\nScribbles, judged on Cycles renders of the written-back files")
    for record in found:
        print(lines(record))
    painted = [one for record in found for one in record["strokes"]]
    print(f"{sum(one['met'] for one in painted)} of {len(painted)} strokes met")
