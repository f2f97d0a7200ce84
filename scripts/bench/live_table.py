"""The page over what `live.py --keep` has kept of each machine."""

import json

from markdown import rows

TEXT = """# How soon an artist sees something

Native part, without Blender's drawing (that is `docs/overlay.md`), of a shot that is baked and trained here and now.
Made from the files beside it by
`.venv-4.2/bin/python scripts/bench/live.py SHOT.blend --keep MACHINE [--device gpu]`.
Under each machine: its processor, what made the pictures, and how many other threads wanted its cores when it began.

{table}
"""


def figure(record):
    """A record for people; the first picture is of half the size where its scale is 2."""
    size = " (half the size)" if record.get("scale") == 2 and "half" not in record["name"] else ""
    return f"{record['value']:.3g} {record['unit']}{size}"


def page(folder):
    """What the README of a folder of kept figures says: a row for each figure, a column for each machine."""
    machines = {path.stem: json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))}
    goals = {record["name"]: (record["goal"], record["unit"]) for records in machines.values() for record in records}
    heads = [
        f"{name}<br>{first['machine']}<br>{first['device']}, others {first['others']:g}, {first['date']}"
        for name, (first, *_) in machines.items()
    ]

    def cells(name):
        goal, unit = goals[name]
        found = (next((figure(r) for r in records if r["name"] == name), "") for records in machines.values())
        return [name, "" if goal is None else f"{goal:g} {unit}", *found]

    return TEXT.format(table=rows(["", "goal", *heads], map(cells, goals)))
