"""The page over what `live.py --keep` has kept of each machine."""

import json

from markdown import rows

TEXT = """# How soon an artist sees something

Native part, without Blender's drawing (that is `docs/overlay.md`), of a shot that is baked and trained here and now.
Made from the files beside it by
`.venv-4.2/bin/python scripts/bench/live.py SHOT.blend --keep MACHINE [--device gpu]`.
Under each machine: its processor, what made the pictures, and how many other threads wanted its cores when it began. A
card has goals of its own.

{table}
"""


def figure(record):
    """A record for people; the first picture is of half the size where its scale is 2."""
    size = " (half the size)" if record.get("scale") == 2 and "half" not in record["name"] else ""
    return f"{record['value']:.3g} {record['unit']}{size}"


def others(record):
    """How many other threads there were, where that is known: not of a machine that is gone."""
    return [f"others {record['others']:g}"] if "others" in record else []


def page(folder):
    """README of a folder of kept figures: a row for each figure, a column for each machine."""
    machines = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}
    goals = {}
    for record in (record for records in machines.values() for record in records):
        goal = "" if record["goal"] is None else f"{record['goal']:g} {record['unit']}"
        goals.setdefault(record["name"], {})[goal] = None
    heads = [
        ", ".join([f"{name}<br>{first['machine']}<br>{first['device']}", *others(first), first["date"]])
        for name, (first, *_) in machines.items()
    ]

    def cells(name):
        found = (next((figure(r) for r in records if r["name"] == name), "") for records in machines.values())
        return [name, " or ".join(goals[name]), *found]

    return TEXT.format(table=rows(["", "goal", *heads], map(cells, goals)))
