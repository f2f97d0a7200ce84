"""Splits a 3D view into a grid of views, each through the camera of a shot, and puts it together again."""

from __future__ import annotations

import math
from typing import Any

import bpy

from ...export.current_shot import entries, shot_camera

MOST_VIEWS = 9

_laid_out: set[int] = set()
"""Areas that were made, by their place in memory."""


def cameras_of(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The cameras of the shots that are on, each once."""
    found = [shot_camera(entry) for entry in entries(scene) if entry.on and not entry.is_foreign]
    return list(dict.fromkeys(camera for camera in found if camera is not None))[:MOST_VIEWS]


def grid(count: int) -> list[int]:
    """Views in each row of a grid, as nearly square as may be, the fuller rows first."""
    rows = math.floor(math.sqrt(count) + 0.5)
    return [count // rows + (row < count % rows) for row in range(rows)]


def lay_out(window: bpy.types.Window, area: bpy.types.Area, cameras: list[bpy.types.Object]) -> None:
    """Splits an area, and has each part look through a camera."""
    parts = []
    for number, row in enumerate(_split(window, area, "HORIZONTAL", len(grid(len(cameras))))):
        parts += _split(window, row, "VERTICAL", grid(len(cameras))[number])
    parts.sort(key=lambda part: (-part.y, part.x))
    for part, camera in zip(parts, cameras, strict=True):
        space = part.spaces.active
        space.use_local_camera, space.camera = True, camera
        space.region_3d.view_perspective = "CAMERA"
        space.show_region_ui = part == area and space.show_region_ui
        _view_all(window, part)
    _laid_out.update(part.as_pointer() for part in parts if part != area)


def _split(window: bpy.types.Window, area: bpy.types.Area, direction: str, count: int) -> list[bpy.types.Area]:
    """Equal parts of an area, in any order."""
    parts = [area]
    for left in range(count, 1, -1):
        known = {other.as_pointer() for other in window.screen.areas}
        largest = max(parts, key=lambda part: part.width * part.height)
        with bpy.context.temp_override(window=window, area=largest, region=_main_region(largest)):
            bpy.ops.screen.area_split(direction=direction, factor=1.0 / left)
        parts += [other for other in window.screen.areas if other.as_pointer() not in known]
    return parts


def _main_region(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "WINDOW")


def _view_all(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Fits the camera's frame into a view."""
    with bpy.context.temp_override(window=window, area=area, region=_main_region(area)):
        bpy.ops.view3d.view_center_camera()


def laid_out(screen: bpy.types.Screen) -> list[bpy.types.Area]:
    """The views of a screen that were made."""
    return [area for area in screen.areas if area.type == "VIEW_3D" and area.as_pointer() in _laid_out]


def put_together(window: bpy.types.Window, area: bpy.types.Area) -> None:
    """Closes the views that were made, and has the one that is left look through the scene's camera."""
    kept = area if area.as_pointer() not in _laid_out else None
    for made in laid_out(window.screen):
        with bpy.context.temp_override(window=window, area=made, region=_main_region(made)):
            bpy.ops.screen.area_close()
    _laid_out.intersection_update(other.as_pointer() for other in window.screen.areas)
    for other in window.screen.areas:
        if other == kept or (kept is None and other.type == "VIEW_3D"):
            other.spaces.active.use_local_camera = False


class RELUME_OT_lay_out(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Split this view into one for each shot that is on, through its camera. Pressed again it puts them together"""

    bl_idname = "relume.lay_out"
    bl_label = "Lay Out"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Only in a 3D view of a window, with cameras in the list or views to put together."""
        if context.area is None or context.area.type != "VIEW_3D" or bpy.app.background:
            return False
        return len(cameras_of(context.scene)) > 1 or bool(laid_out(context.window.screen))

    def execute(self, context: Any) -> set[str]:
        """Called by Blender."""
        if laid_out(context.window.screen):
            put_together(context.window, context.area)
        else:
            lay_out(context.window, context.area, cameras_of(context.scene))
        return {"FINISHED"}
