"""Steps that tests of solving share: begin, go on, and end with a solver that answers what the test says."""

import time

import bpy
import numpy as np

from addon.live.scheduler import scheduler
from addon.ui.solve import operators
from fake_live import FakeLive
from fake_solve import FakeJob

LINE = "[[0.2, 0.5, 1.0], [0.8, 0.5, 1.0]]"


def state_of(scene):
    """All that solving could write to."""
    return {
        obj.name: (
            obj.data.energy,
            tuple(obj.data.color),
            np.round(np.array(obj.matrix_world), 5).tolist(),
            obj.hide_render,
        )
        for obj in scene.objects
        if obj.type == "LIGHT"
    }


def begin(scene):
    """Begins, as far as the native module's work."""
    found = operators.begin(scene)
    while not FakeJob.made:
        found.step()
        time.sleep(0.001)
    return found, FakeJob.made[-1]


def read(reading):
    """The end of what is waited for, as `target_image.awaited`."""
    try:
        while True:
            next(reading)
            time.sleep(0.01)
    except StopIteration as end:
        return end.value


def finish(found, live=None):
    """Goes on to the end, with the picture of the result."""
    live = live or FakeLive.made[-1]
    before = len(live.requests)
    while found.step():
        if len(live.requests) > before:
            before = len(live.requests)
            live.show(serial=live.newest.serial + 1)
            scheduler.tick()


def solve(scene, **answer):
    """Solves to the end."""
    FakeJob.made.clear()
    found, job = begin(scene)
    job.answer(**answer)
    finish(found)
    return found


def target_image(size=(64, 48), value=0.5):
    """An image data-block of one grey."""
    image = bpy.data.images.new("Painting", *size)
    pixels = np.full((size[1], size[0], 4), value, np.float32)
    pixels[..., 3] = 1.0
    image.pixels.foreach_set(pixels.reshape(-1))
    return image
