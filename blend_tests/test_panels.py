"""Every panel and every line of every list draws, also those that are closed at first."""

from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import pytest

from addon.ui import panel
from helpers import row

pytestmark = pytest.mark.every_version


@pytest.fixture(autouse=True)
def width(monkeypatch):
    """Width of the side bar, which there is none of here."""
    monkeypatch.setattr(panel, "characters", lambda *_: 40)


def all_of(kind):
    """The add-on's own registered classes of a kind."""
    return [getattr(bpy.types, name) for name in sorted(dir(bpy.types)) if name.startswith(f"RELUME_{kind}_")]


def context_of(scene):
    """Stands in for Blender's context, as far as panels ask it."""
    shading = SimpleNamespace(type="RENDERED", relume=None)
    view = SimpleNamespace(region_3d=SimpleNamespace(view_perspective="CAMERA"), shading=shading)
    places = {"space_data": view, "region": SimpleNamespace(width=400), "view_layer": bpy.context.view_layer}
    return SimpleNamespace(scene=scene, preferences=bpy.context.preferences, engine="RELUME", **places)


def draw_panels(scene):
    """Draws each panel that Blender would; their names."""
    context, drawn = context_of(scene), []
    for kind in all_of("PT"):
        if not hasattr(kind, "poll") or kind.poll(context):
            for part in ("draw_header", "draw"):
                if hasattr(kind, part):
                    getattr(kind, part)(SimpleNamespace(layout=MagicMock()), context)
            drawn.append(kind.__name__)
    return drawn


def draw_lists(scene):
    """Draws each line of each list; how many lines of each."""
    solve = scene.relume_solve
    items = {
        "RELUME_UL_rows": scene.relume_mix.rows,
        "RELUME_UL_looks": scene.relume_looks.items,
        "RELUME_UL_regions": solve.regions,
        "RELUME_UL_shots": scene.relume_shots.items,
    }
    assert sorted(items) == [kind.__name__ for kind in all_of("UL")]
    for name, found in items.items():
        for item in found:
            getattr(bpy.types, name).draw_item(
                SimpleNamespace(), context_of(scene), MagicMock(), scene, item, 0, scene, ""
            )
    return {name: len(found) for name, found in items.items()}


def test_panels_draw_without_a_bake(lit):
    assert "RELUME_PT_main" in draw_panels(lit)
    draw_lists(lit)


def test_panels_draw_with_all_that_there_can_be(painted):
    bpy.ops.relume.snapshot()
    settings, key = painted.relume_solve, row(painted, "Key").locks
    for limits in (settings, key):
        limits.limit_strength = limits.limit_turn = limits.limit_size = limits.limit_sun = limits.limit_cone = True
    painted.relume_mix.active = list(painted.relume_mix.rows).index(row(painted, "Key"))
    drawn = draw_panels(painted)
    assert {"RELUME_PT_solve", "RELUME_PT_solve_locks", "RELUME_PT_solve_own_limits", "RELUME_PT_looks"} <= set(drawn)
    lines = draw_lists(painted)
    assert lines["RELUME_UL_rows"] > 1 and lines["RELUME_UL_looks"] == 1
