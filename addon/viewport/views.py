"""All 3D views that are open."""

from __future__ import annotations

import bpy


def redraw() -> None:
    """Asks every 3D view of every window to draw itself again."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                for region in area.regions:
                    if region.type == "WINDOW":
                        region.tag_redraw()
