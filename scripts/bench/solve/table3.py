"""The paper's table 3: random sphere lights found again from random ones, by the share of pixels that a step looks at.

The file's own lights, its world and all emission are off, so that the spheres are the only light. The target is a
Cycles render; what is found is written into the file, rendered by Cycles with another seed, and compared on
exposure-normalised Reinhard pictures. `ceiling_psnr` compares two renders of the target lights: no
solver gets above it.
"""

from itertools import pairwise
from statistics import mean

from problem import FREE, parameter_error, random_spheres, shape_of, spheres_of
from records import GENERAL, general

from addon.core.metrics import psnr_reinhard

SCENES = ("cornell_box", "kitchen", "modern_hall")
LIGHTS = (1, 3, 5, 20)
FRACTIONS = (1.0, 0.5, 0.25, 0.05, 0.01, 0.001)
MANY_STARTS_FRACTION = 0.05
"""At which pixel fraction more than one start is tried."""
PAPER = {
    1: (39.5, 39.4, 39.4, 39.1, 39.0, 39.0),
    3: (29.6, 29.9, 29.9, 29.8, 30.7, 31.3),
    5: (32.1, 32.0, 32.2, 32.4, 32.0, 31.1),
    20: (32.4, 32.6, 32.5, 32.6, 32.6, 31.8),
}
"""PSNR in dB by the number of lights and pixel fraction."""
TARGET_SEED, CEILING_SEED, RESULT_SEED = 1, 2, 3


def run(shot, records, args):
    """All cells of one scene that are not measured yet."""
    space = None
    for number in range(args.runs):
        for count in args.lights or LIGHTS:
            wanted = [cell for cell in cells(shot, args, number, count) if not records.has(cell)]
            if not wanted:
                continue
            if space is None:
                shot.open(bare=True)
                space = shot.judge.space()
            problem = Problem(shot, space, number, count)
            for cell in wanted:
                record = cell | problem.solve(cell)
                records.add(record)
                print(line(record), flush=True)


def cells(shot, args, number, count):
    """Settings of what is to be measured."""
    same = {"table": "3", "scene": shot.name, "lights": count, "run": number, "through": args.through}
    same |= {"least_cells": args.least_cells} | general(args)
    for starts in args.starts:
        for fraction in args.fractions or FRACTIONS:
            if starts == 1 or fraction == MANY_STARTS_FRACTION:
                yield same | {"pixel_fraction": fraction, "starts": starts}


class Problem:
    """Target lights, and the lights that solving starts from."""

    def __init__(self, shot, space, number, count):
        self.shot, self.space, self.seed = shot, space, 1000 * number + 2 * count
        self.target = random_spheres(shot.judge, space, self.seed, count)
        self.start = random_spheres(shot.judge, space, self.seed + 1, count)
        shot.judge.set(lights=self.target, only=True)
        self.picture = shot.picture(TARGET_SEED)
        self.ceiling = psnr_reinhard(shot.picture(CEILING_SEED), self.picture)
        shot.judge.set(lights=self.start, only=True)
        self.lights = shot.judge.describe()
        self.initial = psnr_reinhard(shot.picture(RESULT_SEED), self.picture)

    def request(self, cell):
        """Request to `relume.solve`."""
        return {
            "lights": self.lights,
            "world": [0, 0, 0],
            "static": [0, 0, 0],
            "free": {light["name"]: FREE for light in self.lights},
            "bounds": self.space,
            "goals": [{"goal": "target", "image": "target"}],
            "keep_rest": 0.0,
            "starts": cell["starts"],
            "pixel_fraction": cell["pixel_fraction"],
            "least_cells": cell["least_cells"],
            "seed": self.seed,
        }

    def solve(self, cell):
        """Measurements of a cell."""
        result = self.shot.solve(self.request(cell), {"target": self.picture})
        self.shot.judge.set(lights=self.start, only=True)
        self.shot.judge.set(lights=result["blender"])
        self.shot.judge.remove(names=result["removed"])
        psnr = psnr_reinhard(self.shot.picture(RESULT_SEED), self.picture)
        wanted = [shape_of(light) for light in self.target]
        return {
            "psnr": psnr,
            "initial_psnr": self.initial,
            "ceiling_psnr": self.ceiling,
            "seconds": result["seconds"],
            "processor_seconds": result["processor_seconds"],
            "parameter_error": parameter_error(spheres_of(result["lights"]), wanted, self.space),
            "initial_parameter_error": parameter_error([shape_of(light) for light in self.start], wanted, self.space),
            "method": f"relume {result['through']}",
        }


def line(record):
    """One cell as it is done."""
    return (
        "  {scene:12} {lights:2} lights, pixels {pixel_fraction:5}, {starts} starts, run {run}: {initial_psnr:5.1f} ->"
        " {psnr:5.1f} dB of {ceiling_psnr:.1f}, parameters {initial_parameter_error:.3f} -> {parameter_error:.3f},"
        " {seconds:.1f} s ({processor_seconds:.0f} on one core), {method}".format(**record)
    )


def show(records):
    """A table for each setting, means over scenes and runs, beside the paper's."""
    found = records.select(table="3")
    for setting in sorted({setting_of(record) for record in found}):
        of_setting = [record for record in found if setting_of(record) == setting]
        print("\nTable 3: PSNR in dB of Cycles renders of what was found (the paper's)  [runs, processor seconds]")
        print(", ".join(setting), "(rows: share of cells of each gradient step; the polish looks at up to 4096)")
        show_setting(of_setting)
        show_same(of_setting)


def setting_of(record):
    """Settings that records of one table share, in words."""
    return tuple(f"{key.replace('_', ' ')} {record[key]}" for key in ("through", "least_cells", *GENERAL))


def show_setting(found):
    """Rows of one table."""
    counts = sorted({record["lights"] for record in found})
    row("Initial", counts, found, lambda chosen, _: f"{mean(r['initial_psnr'] for r in chosen):.1f}")
    row("Ceiling", counts, found, lambda chosen, _: f"{mean(r['ceiling_psnr'] for r in chosen):.1f}")
    for starts in sorted({record["starts"] for record in found}):
        for place, fraction in enumerate(FRACTIONS):
            chosen = [r for r in found if r["pixel_fraction"] == fraction and r["starts"] == starts]
            if chosen:
                label = f"{fraction:.1%}" + (f", {starts} starts" if starts > 1 else "")
                row(label, counts, chosen, lambda some, count, place=place: cell_text(some, PAPER[count][place]))


def show_same(found):
    """Says which rows are one solve: a step looks at some cells of up to 8 x 8 pixels at least, whatever the share."""

    def errors(fraction):
        some = [record for record in found if record["pixel_fraction"] == fraction and record["starts"] == 1]
        return {(r["scene"], r["lights"], r["run"]): r["parameter_error"] for r in some}

    for larger, smaller in pairwise(FRACTIONS):
        results = [errors(larger), errors(smaller)]
        both = results[0].keys() & results[1].keys()
        same = sum(results[0][key] == results[1][key] for key in both)
        if same:
            least = f"a step looks at {found[0]['least_cells']} cells of up to 8 x 8 pixels at least"
            print(f"{same} of {len(both)} solves of {larger:.1%} and {smaller:.1%} are the same: {least}")


def cell_text(chosen, paper):
    """PSNR, the paper's, number of solves, seconds on one core, which other work on the machine hardly changes."""
    seconds = mean(record["processor_seconds"] for record in chosen)
    return f"{mean(record['psnr'] for record in chosen):.1f} ({paper}) [{len(chosen)}, {seconds:.1f} s]"


def row(label, counts, records, text):
    """One printed row: a column for each number of lights."""
    by_count = [[record for record in records if record["lights"] == count] for count in counts]
    texts = [text(chosen, count) if chosen else "-" for chosen, count in zip(by_count, counts, strict=True)]
    titled = [f"{count:2} lights: {cell:26}" for cell, count in zip(texts, counts, strict=True)]
    print(f"{label:18} " + " ".join(titled))
