"""Rows and looks of a tiny shot with the real native module."""

import bpy
import numpy as np
import pytest

from addon.core.rows import GROUP, LIGHT, STATIC, WORLD
from addon.live import comparison as comparing
from addon.live.scheduler import scheduler
from addon.ui import looks, mixer
from addon.ui.start import start
from addon.viewport import compare as pairs
from helpers import add_light, add_world, row, settled, until


def picture(scene, what):
    """The settled picture."""
    return until(scene, settled, what).frame.image[..., :3]


@pytest.fixture
def shown(studio):  # noqa: F811
    """Two lights, one in a group, and a world, baked and shown."""
    rig = bpy.data.collections.new("Rig")
    studio.collection.children.link(rig)
    fill = add_light(studio, "AREA", "Fill", location=(-1, 0, 2), color=(1.0, 0.5, 0.2))
    studio.collection.objects.unlink(fill)
    rig.objects.link(fill)
    add_world(studio)
    bpy.context.view_layer.update()
    start(studio)
    picture(studio, "the first pictures")
    return studio


def dial(scene):
    """Values in every kind of row."""
    row(scene, "Key").exposure, row(scene, "Key").color = 1.0, (1.0, 0.5, 0.25)
    row(scene, "Fill").use_kelvin, row(scene, "Fill").kelvin = True, 3000.0
    row(scene, "Rig", GROUP).multiplier = 0.5
    row(scene, "World", WORLD).color, row(scene, "World", WORLD).multiplier = (1.0, 0.5, 0.5), 2.0


def test_rows_make_the_picture_and_apply_keeps_it(shown):
    neutral = picture(shown, "the neutral picture").copy()
    dial(shown)
    before = picture(shown, "the picture of the rows").copy()
    assert np.abs(before - neutral).max() > 0.1 * neutral.max()
    bpy.ops.relume.apply_to_lights()
    bpy.context.view_layer.update()
    assert row(shown, "Key").exposure == 0.0
    assert np.abs(picture(shown, "the applied picture") - before).max() < 1e-4 * before.max()
    mixer.apply_to_lights(shown)
    assert np.abs(picture(shown, "the same once more") - before).max() < 1e-4 * before.max()


def test_solo_adds_up_to_the_whole(shown):
    whole = picture(shown, "all").copy()
    parts = np.zeros_like(whole)
    for name, kind in (("Key", LIGHT), ("Rig", GROUP), ("World", WORLD), ("Emissive Materials", STATIC)):
        row(shown, name, kind).solo = True
        parts += picture(shown, name)
        row(shown, name, kind).solo = False
    assert np.abs(parts - whole).max() < 1e-3 * whole.max()


def test_looks_are_compared_as_they_looked(shown):
    one = picture(shown, "one").copy()
    looks.snapshot(shown, "One")
    dial(shown)
    bpy.data.objects["Key"].location.x = -1.5
    bpy.context.view_layer.update()
    two = picture(shown, "two").copy()
    looks.snapshot(shown, "Two")
    mixer.reset(shown)
    row(shown, "Key").on = False
    dark = picture(shown, "the live one").copy()
    items = shown.relume_looks.items
    comparison = comparing.start(shown, [items["One"], items["Two"]])
    until(shown, lambda _found: not comparison.step(), "both looks")
    pair = pairs.pair_of(shown)
    assert np.abs(pair.a.image[..., :3] - one).max() < 1e-4 * one.max()
    assert np.abs(pair.b.image[..., :3] - two).max() < 1e-4 * two.max()
    assert np.abs(picture(shown, "the live one again") - dark).max() < 1e-4 * one.max()
    assert np.abs(dark - one).max() > 0.01
    looks.restore(shown, items["One"].look(), lights=True)
    bpy.context.view_layer.update()
    assert np.abs(picture(shown, "the restored one") - one).max() < 1e-4 * one.max()
    comparing.stop(shown)
    scheduler.close_all()
