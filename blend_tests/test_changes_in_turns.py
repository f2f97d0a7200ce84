"""Changes since the bake are looked for a moment at a time."""

import math
from types import SimpleNamespace

import bpy

from addon.engine.staleness import fingerprints, shape_fingerprints
from addon.engine.staleness.tracker import StalenessTracker
from helpers import add_quad

MANY = 40


def looks(found, scene):
    """How many turns it takes to look at everything, one step in each."""
    turns = 0
    while found.is_pending:
        found.update(scene, 0.0)
        turns += 1
        assert turns < 10 * MANY
    return turns


def test_a_large_mesh_is_looked_at_in_slices(lit, monkeypatch):
    whole = fingerprints.all_fingerprints(lit, lit.camera)["data Plane"]
    monkeypatch.setattr(shape_fingerprints, "SLICE_BYTES", 8)
    sizes = [48, 16, 32, 1]  # Of positions, corners, UVs and flatness.
    assert len(list(fingerprints.fingerprint(lit, "data Plane"))) == sum(math.ceil(size / 8) for size in sizes)
    found = StalenessTracker({"data Plane": whole})
    assert looks(found, lit) > 15 and found.present["data Plane"] == whole


def test_a_walk_that_finds_nothing_new_goes_in_turns_too(lit):
    stones = [add_quad(lit, f"Stone {number}") for number in range(MANY)]
    bpy.context.view_layer.update()
    found = StalenessTracker(None)
    looks(found, lit)
    lit.collection.objects.unlink(stones[0])
    found.mark(lit, [SimpleNamespace(id=lit.collection)])
    assert looks(found, lit) > MANY
    assert found.sentences == ["'Stone 0' was deleted or hidden"]
