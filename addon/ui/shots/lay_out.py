"""Splits a 3D view into a grid of views, each through the camera of a shot, and puts it together again."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import Any

import bpy

from ...export.current_shot import entries, shot_camera

MOST_VIEWS = 9
STEP_SECONDS = 0.02

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


def lay_out(window: bpy.types.Window, area: bpy.types.Area, cameras: list[bpy.types.Object]) -> Iterator[None]:
    """Splits an area, and has each part look through a camera. Blender gives new areas their size in a later turn."""
    columns = grid(len(cameras))
    parts = []
    rows = yield from _split(window, area, "HORIZONTAL", len(columns))
    for number, row in enumerate(sorted(rows, key=lambda row: -row.y)):
        parts += yield from _split(window, row, "VERTICAL", columns[number])
    parts.sort(key=lambda part: (-part.y, part.x))
    _laid_out.update(part.as_pointer() for part in parts if part != area)
    for part, camera in zip(parts, cameras, strict=False):
        space = part.spaces.active
        space.use_local_camera, space.camera = True, camera
        space.region_3d.view_perspective = "CAMERA"
        space.show_region_ui = part == area and space.show_region_ui
    yield
    for part in parts:
        with bpy.context.temp_override(window=window, area=part, region=_main_region(part)):
            bpy.ops.view3d.view_center_camera()


def _split(
    window: bpy.types.Window, area: bpy.types.Area, direction: str, count: int
) -> Generator[None, None, list[bpy.types.Area]]:
    """Equal parts of an area, in any order; fewer where it is too small."""
    parts = [area]
    for left in range(count, 1, -1):
        known = {other.as_pointer() for other in window.screen.areas}
        largest = max(parts, key=lambda part: part.width * part.height)
        with bpy.context.temp_override(window=window, area=largest, region=_main_region(largest)):
            bpy.ops.screen.area_split(direction=direction, factor=1.0 / left)
        parts += [other for other in window.screen.areas if other.as_pointer() not in known]
        while not all(part.width for part in parts):
            yield
    return parts


def _main_region(area: bpy.types.Area) -> bpy.types.Region:
    return next(region for region in area.regions if region.type == "WINDOW")


def laid_out(screen: bpy.types.Screen) -> list[bpy.types.Area]:
    """The views of a screen that were made."""
    return [area for area in screen.areas if area.type == "VIEW_3D" and area.as_pointer() in _laid_out]


def put_together(window: bpy.types.Window) -> Iterator[None]:
    """Closes the views that were made, one in a turn, and has those that are left look through the scene's camera."""
    while made := laid_out(window.screen):
        _laid_out.discard(made[0].as_pointer())
        with bpy.context.temp_override(window=window, area=made[0], region=_main_region(made[0])):
            bpy.ops.screen.area_close()
        yield
    for area in window.screen.areas:
        if area.type == "VIEW_3D":
            area.spaces.active.use_local_camera = False


def _play(steps: Iterator[None]) -> None:
    def step() -> float | None:
        for _ in steps:
            return STEP_SECONDS
        return None

    bpy.app.timers.register(step)


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
            _play(put_together(context.window))
        else:
            _play(lay_out(context.window, context.area, cameras_of(context.scene)))
        return {"FINISHED"}
