"""Kinds of hunts: each kind makes rounds, and a round is one random thing."""

from typing import Any, NamedTuple

import closures
import graphs
import lamps
import settings
import transforms
import worlds


class Cards(NamedTuple):
    """Many rounds in a picture, each a material on a thing of its own in a cell of the grid."""

    make: Any
    """The module: `prepare(rng, width, height)` -> scene, `add(scene, rng, palette, name, x, y)`."""
    columns: int
    rows: int
    cell: int
    """Pixels of a cell's side."""
    samples: int
    """Samples of each of the four pictures."""

    @property
    def in_a_picture(self):
        """How many rounds a picture holds."""
        return self.columns * self.rows


class Shots(NamedTuple):
    """A scene each: `prepare(rng)` -> scene, `choices(scene, rng, palette)` -> what can be left out one by one."""

    make: Any
    samples: int

    in_a_picture = 1


KINDS = {
    "graphs": Cards(graphs, columns=8, rows=6, cell=8, samples=64),
    "closures": Cards(closures, columns=6, rows=4, cell=16, samples=128),
    "worlds": Cards(worlds, columns=1, rows=1, cell=32, samples=64),
    "lamps": Shots(lamps, samples=64),
    "transforms": Shots(transforms, samples=64),
    "settings": Shots(settings, samples=64),
}
