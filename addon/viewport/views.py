"""All 3D views that are open."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import bpy

from ..core.pass_names import COMBINED
from ..engine.render.render_engine import ENGINE

SETTLE_SECONDS = 0.1


def regions(*kinds: str) -> Iterator[bpy.types.Region]:
    """Regions of these types of all 3D views."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield from (region for region in area.regions if region.type in kinds)


def pass_of(space: bpy.types.SpaceView3D) -> str:
    """The pass that a view shows in its shading "Rendered", by its name in final renders."""
    return space.shading.relume.name_of_pass


def passes_of(scene: bpy.types.Scene) -> set[str]:
    """The single passes that views of a scene show."""
    if scene.render.engine != ENGINE:
        return set()
    windows = [window for window in bpy.context.window_manager.windows if window.scene == scene]
    spaces = [area.spaces.active for window in windows for area in window.screen.areas if area.type == "VIEW_3D"]
    return {pass_of(space) for space in spaces if space.shading.type == "RENDERED"} - {COMBINED}


def redraw(*kinds: str) -> None:
    """Asks every 3D view of every window to draw itself again, or regions of these types, such as the side bar
    ("UI")."""
    for region in regions(*kinds or ("WINDOW",)):
        region.tag_redraw()


def settle() -> None:
    """Redraws the side bars twice: Blender puts panels below longer ones in their places one drawing later."""
    redraw("UI")
    if not bpy.app.background:
        bpy.app.timers.register(partial(redraw, "UI"), first_interval=SETTLE_SECONDS)
