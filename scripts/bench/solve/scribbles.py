"""Strokes with a known good answer: a hidden change of two lights, painted, solved for and judged by Cycles.

What the hidden change makes brighter, darker, warmer, cooler or of another colour is painted, at 80 % of the change,
and what it leaves alone as kept. Every light of the file may change what the strokes are about (its strength, its
colour), those of the hidden change may also move where one has moved. What is found is written into the file as *Apply*
of the add-on does; the file is saved, opened again and rendered with the seed of the picture before, with more samples
where the render and the solver disagree. Files with fewer than two lights get seeded point lights, and each gets a spot
that lights a part of the picture: without it every light of a closed room reaches all that is seen, and nothing would
be left to be kept.
"""

import json
import math
import random
import tempfile
from pathlib import Path

import relume
import strokes
from problem import IDENTITY, random_spheres
from records import general
from shot import Shot

from addon.core.solve import SolveOptions
from addon.core.solve import request as solver_request

SCENES = ("cornell_box", "kitchen", "modern_hall", "classroom", "coffee_maker", "sponza")
LEAST_LIGHTS = 2
LEAST_SHARE = 0.15
"""Share of the picture that a light must give to be changed."""
MOVE = 0.12
"""Length of a move, in diagonals of what the camera sees."""
KEEP_LIMIT = 0.02
STARTS = 4
"""Starts of a solve, as many as the add-on has."""
SEED = 1
MOST_SAMPLES = 2048
"""Samples at most of a render by which strokes are judged."""
AGREED = {"stops": 0.1, "mireds": 10.0, "keep": 0.005, "color": 0.05}
AGREED_SHARE = 0.15
"""By which, and by which share of what was asked for, a render and the solver may differ without more samples."""
MIREDS = 100.0
ACCENT = "Accent"
"""The spot's name."""
ACCENT_SHARE = 0.25
"""Share of the picture's mean that the spot gives."""
ACCENT_CONE = math.radians(45.0)
ACCENT_COLOR = [0.25, 0.7, 1.0]
"""Factors of the spot's colour where a colour is asked for."""
CANDIDATES = 9
"""Places for the spot, of which that of medium brightness is taken: not one before a wall, not one out of sight."""
RUNS = (
    ("brighter", "keep"),
    ("brighter", "darker", "keep"),
    ("warmer", "cooler", "keep"),
    ("shadow", "brighter", "keep"),
    ("color", "keep"),
)
"""Goals that are painted. The spot becomes a stop brighter; a light a stop darker, and another moves; a light warmer,
another cooler; a light moves; the spot gets another colour."""


def run(shot, records, args):
    """All runs of one scene that are not measured yet."""
    numbers = [number for number in range(args.runs) if not records.has(settings(shot, args, number))]
    if not numbers:
        return
    shot = Shot(shot.judge, shot.name, args, lit(shot))
    for number in numbers:
        shot.open(bare=False)
        record = settings(shot, args, number) | Shown(shot, number).measure()
        records.add(record)
        print(lines(record), flush=True)


def lit(shot):
    """The scene with the lights that are missing, in a file of its own: paths are to look for these as well."""
    path = shot.folder.with_name(f"{shot.name}-lit.blend")
    if not path.exists():
        shot.open(bare=False)
        Lighting(shot).add()
        shot.judge.save(path=str(path))
    return path


def settings(shot, args, number):
    """Fields that a run's record is known by."""
    same = {"table": "scribbles", "scene": shot.name, "run": number, "through": args.through} | general(args)
    same |= {"seed": args.seed} if args.seed else {}
    return same | {"lights": None, "pixel_fraction": 0.05, "starts": STARTS}


class Lighting:
    """Lights that are added to an open scene, and how bright they are to be."""

    def __init__(self, shot):
        self.shot, self.space = shot, shot.judge.space()

    def add(self):
        """Point lights where there are fewer than two lights, and the spot."""
        missing = LEAST_LIGHTS - len(self.shot.judge.describe())
        if missing > 0:
            self._add_points(missing)
        self._add_accent()

    def _add_points(self, count):
        lights = random_spheres(self.shot.judge, self.space, 7, count)
        level = self._static_level()
        self.shot.judge.set(lights=lights)
        found = shares(self.shot)
        for light in lights:
            light["energy"] *= 0.5 * level / max(found[light["name"]], 1e-9)
        self.shot.judge.set(lights=lights)

    def _add_accent(self):
        level = self._static_level() + sum(shares(self.shot).values())
        places = self.shot.judge.places(seed=8, count=CANDIDATES, space=self.space)
        radius = self.space["size"][0]
        spots = [spot(f"{ACCENT} {number}", place, radius) for number, place in enumerate(places)]
        self.shot.judge.set(lights=spots)
        found = shares(self.shot)
        taken = sorted(spots, key=lambda light: found[light["name"]])[CANDIDATES // 2]
        self.shot.judge.remove(names=[light["name"] for light in spots])
        energy = taken["energy"] * ACCENT_SHARE / (1 - ACCENT_SHARE) * level / found[taken["name"]]
        self.shot.judge.set(lights=[taken | {"name": ACCENT, "energy": energy}])

    def _static_level(self):
        """Mean of the picture without any added lights."""
        relit = relume.Relighter(self.shot.folder).relight(maker="gather", denoise=False)
        return float(relit["combined"].mean())


def shares(shot):
    """Mean of each light's own picture."""
    lights = json.dumps(shot.judge.light_set())
    relit = relume.Relighter(shot.folder).relight(lights, maker="gather", denoise=False)
    return {name: float(picture.mean()) for name, picture in relit["lights"].items()}


class Shown:
    """A scene before and after its hidden change."""

    def __init__(self, shot, number):
        self.shot, self.rng = shot, random.Random(100 + number + shot.args.seed)
        self.space = shot.judge.space()
        self.lights = shot.judge.describe()
        self.before = shot.picture(SEED)
        self.changed, self.free = self._hidden_change(number)
        self.goals = strokes.paint(self.before, shot.picture(SEED), RUNS[number], self.rng)
        shot.judge.put_back()

    def _hidden_change(self, number):
        """Changes lights that matter in the open file; their names, and what may change of each light."""
        found = shares(self.shot)
        able = sorted(name for name, share in found.items() if share >= LEAST_SHARE * sum(found.values()))
        self.rng.shuffle(able)
        first, second = able[0], able[1 % len(able)]
        change, names = self.shot.judge.change, [light["name"] for light in self.lights]
        if number == 0:
            change(name=ACCENT, gain=2.0)
            return [ACCENT], {name: ["strength"] for name in names}
        if number == 4:
            change(name=ACCENT, tint=ACCENT_COLOR)
            return [ACCENT], {name: ["strength", "color"] for name in names}
        if number == 2:
            change(name=first, tint=tint(MIREDS))
            if second != first:
                change(name=second, tint=tint(-MIREDS))
            return sorted({first, second}), {name: ["strength", "color"] for name in names}
        if number == 1:
            change(name=first, gain=0.5)
        change(name=second, move=self._move())
        changed = sorted({first, second}) if number == 1 else [second]
        free = {name: ["strength"] for name in names}
        return changed, free | {name: ["strength", "position"] for name in changed}

    def _move(self):
        direction = [self.rng.gauss(0, 1) for _ in "xyz"]
        length = MOVE * math.dist(self.space["min"], self.space["max"]) / math.hypot(*direction)
        return [length * value for value in direction]

    def request(self):
        """Request of the add-on to `relume.solve`, with its defaults."""
        shown = {"lights": self.lights, "gains": {}, "world": [1.0] * 3, "static": [1.0] * 3}
        options = SolveOptions(self.free, [goal for goal, _ in self.goals], starts=STARTS, steps=self.shot.args.steps)
        return solver_request(shown, options)

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
            }
        request = self.request()
        result = self.shot.solve(request)
        self.shot.judge.apply(answer=result, asked=request["lights"])
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "solved.blend")
            self.shot.judge.save(path=path)
            found, samples = self._judged(path, {row["number"]: row for row in result["report"]})
        return {
            "strokes": found,
            "judged_samples": samples,
            "changed": self.changed,
            "psnr": None,
            "parameter_error": None,
            "seconds": result["seconds"],
            "method": f"relume {result['through']}",
        }

    def _judged(self, path, said):
        """Each stroke by renders of the file as it was and as solved, and their samples: four times as many as long
        as a render and the solver disagree, since either may be noise."""
        samples, before = self.shot.args.samples, self.before
        while True:
            self.shot.judge.open(blend=path, size=self.shot.size)
            after = self.shot.judge.picture(samples, SEED)
            goals = enumerate(self.goals)
            found = [verdict(goal, known, before, after, said.get(number)) for number, (goal, known) in goals]
            if samples >= MOST_SAMPLES or not any(disagrees(one) for one in found):
                return found, samples
            samples *= 4
            self.shot.open(bare=False)
            before = self.shot.judge.picture(samples, SEED)


def spot(name, place, radius):
    """A white spot light that points down."""
    matrix = [[*IDENTITY[axis], place[axis]] for axis in range(3)] + [[0.0, 0.0, 0.0, 1.0]]
    cone = {"spot_size": ACCENT_CONE, "spot_blend": 0.2, "radius": radius}
    look = {"energy": 100.0, "color": [1.0, 1.0, 1.0], "use_soft_falloff": False}
    return {"name": name, "type": "SPOT", "world_from_object": matrix} | cone | look


def tint(mireds):
    """Factors of a colour that make it warmer by so much and leave its luminance of white."""
    half = 0.5 * strokes.RATIO_PER_MIRED * mireds
    color = [math.exp(half), 1.0, math.exp(-half)]
    brightness = sum(weight * channel for weight, channel in zip(strokes.LUMINANCE, color, strict=True))
    return [channel / brightness for channel in color]


def verdict(goal, known, before, after, said):
    """One stroke: asked, done by the hidden change, by what was found (Cycles), and by what was found as it is said."""
    kind = goal["goal"]
    reached = strokes.done_to(goal, before, after)
    asked = strokes.asked(goal)
    met = reached < KEEP_LIMIT if kind == "keep" else reached >= asked
    found = {"goal": kind, "asked": asked, "known": known, "reached": reached, "met": met}
    return found | {"said": said and told(kind, said)}


def disagrees(found):
    """True if the render of a verdict shows something else than the solver says."""
    kind = found["goal"]
    limit = max(AGREED[strokes.UNITS.get(kind, kind)], AGREED_SHARE * found["asked"] * (kind in strokes.UNITS))
    return found["said"] is not None and abs(found["reached"] - found["said"]) > limit


def told(kind, said):
    """Change at a stroke that the solver says, in the measure of this script."""
    if kind == "color":
        return 1.0 - said["reached"] / said["before"]
    return said["reached"] * (-1.0 if kind in {"darker", "shadow", "cooler"} else 1.0)


def lines(record):
    """A line for each stroke."""
    samples = record.get("judged_samples", record["samples"])
    texts = []
    for found in record["strokes"]:
        unit = strokes.UNITS.get(found["goal"], "(share)")
        said = "-" if found["said"] is None else f"{found['said']:.3f}"
        texts.append(
            f"  {record['scene']:12} run {record['run']}  {found['goal']:8} asked {found['asked']:7.3f}"
            f"  known answer {found['known']:7.3f}  reached {found['reached']:7.3f} {unit:7} (the solver says {said})"
            f"  {samples} samples  {'met' if found['met'] else 'MISSED'}"
        )
    texts += [
        f"  {record['scene']:12} run {record['run']}  {kind:8} not painted: the hidden change leaves no place for it"
        for kind in unpainted(record)
    ]
    return "\n".join(texts)


def unpainted(record):
    """Kinds of strokes that had no place."""
    painted = {found["goal"] for found in record["strokes"]}
    return [kind for kind in RUNS[record["run"]] if kind not in painted]


def show(records):
    """All strokes, and how many are met."""
    for seed in sorted({record.get("seed", 0) for record in records.select(table="scribbles")}):
        show_seed(seed, [record for record in records.select(table="scribbles") if record.get("seed", 0) == seed])


def show_seed(seed, records):
    """Those of one seed."""
    found = sorted(records, key=lambda record: (record["scene"], record["run"]))
    of_seed = f", hidden changes and strokes of seed {seed}" if seed else ""
    print(f"\nScribbles, judged on Cycles renders of the written-back files{of_seed}")
    for record in found:
        print(lines(record))
    painted = [one for record in found for one in record["strokes"]]
    missing = sum(len(unpainted(record)) for record in found)
    print(f"{sum(one['met'] for one in painted)} of {len(painted)} strokes met, {missing} had no place")
