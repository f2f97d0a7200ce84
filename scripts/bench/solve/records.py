"""The measured records, kept in a file so that a stopped run goes on where it was."""

import json

GENERAL = ("size", "steps", "samples", "bake_samples")
"""Options of the command line that belong to every record."""
SETTINGS = ("table", "scene", "lights", "pixel_fraction", "starts", "run", "through", "least_cells", "seed", *GENERAL)
"""Fields that two records of the same measurement share."""


class Records:
    """A list of flat records in a JSON file."""

    def __init__(self, path):
        self.path = path
        self.all = json.loads(path.read_text()) if path.exists() else []

    def add(self, record, **more):
        """Keeps a record; one of the same settings goes."""
        self.all = [old for old in self.all if not same(old, record)] + [record | more]
        self.path.parent.mkdir(parents=True, exist_ok=True)
        lines = ",\n".join(json.dumps(record) for record in self.all)
        self.path.write_text(f"[\n{lines}\n]\n")

    def has(self, settings):
        """True if a record of these settings is there."""
        return any(same(old, settings) for old in self.all)

    def select(self, **fields):
        """Those whose fields have these values."""
        return [record for record in self.all if all(record.get(key) == value for key, value in fields.items())]


def same(a, b):
    """True if settings agree."""
    return all(a.get(key) == b.get(key) for key in SETTINGS)


def general(args):
    """The part of a record that the command line gives."""
    return {key: getattr(args, key) for key in GENERAL}
