"""All 3D views that are open."""

from __future__ import annotations

from functools import partial

import bpy

SETTLE_SECONDS = 0.1


def redraw(kind: str = "WINDOW") -> None:
    """Asks every 3D view of every window to draw itself again, or its side bar ("UI")."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == kind:
                        region.tag_redraw()


def settle() -> None:
    """Redraws the side bars twice: Blender puts panels below longer ones in their places one drawing later."""
    redraw("UI")
    if not bpy.app.background:
        bpy.app.timers.register(partial(redraw, "UI"), first_interval=SETTLE_SECONDS)
