"""All 3D views that are open."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import bpy

from ..core.pass_names import COMBINED
from ..engine.render.render_engine import ENGINE
from ..engine.shot import open_shots
from ..engine.shot.shot import Shot
from .camera_frame import camera_of

SETTLE_SECONDS = 0.1


def regions(*kinds: str) -> Iterator[bpy.types.Region]:
    """Regions of these types of all 3D views."""
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                yield from (region for region in area.regions if region.type in kinds)


@dataclass(frozen=True)
class View:
    """A 3D view that looks through a camera."""

    area: int
    """Tells it from others."""
    camera: bpy.types.Object
    is_local: bool
    """True if the camera is the view's own, not the scene's."""
    layer: str
    """View layer of its window."""


def _spaces_of(scene: bpy.types.Scene) -> Iterator[tuple[bpy.types.Window, bpy.types.Area, bpy.types.SpaceView3D]]:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas if window.scene == scene else ():
            if area.type == "VIEW_3D":
                yield window, area, area.spaces.active


def through_cameras(scene: bpy.types.Scene) -> Iterator[View]:
    """The 3D views of a scene that look through a camera of it."""
    for window, area, space in _spaces_of(scene):
        camera = camera_of(scene, space)
        if camera is not None and space.region_3d.view_perspective == "CAMERA":
            yield View(area.as_pointer(), camera, space.use_local_camera, window.view_layer.name)


def pass_of(space: bpy.types.SpaceView3D) -> str:
    """The pass that a view shows in its shading "Rendered", by its name in final renders."""
    return space.shading.relume.name_of_pass


def passes_of(scene: bpy.types.Scene, shot: Shot) -> set[str]:
    """The single passes of a shot that views of a scene show."""
    if scene.render.engine != ENGINE:
        return set()
    spaces = [space for _, _, space in _spaces_of(scene) if space.shading.type == "RENDERED"]
    shown = [space for space in spaces if open_shots.showing(scene, camera_of(scene, space)) in {shot, None}]
    return {pass_of(space) for space in shown} - {COMBINED}


def redraw(*kinds: str) -> None:
    """Asks every 3D view of every window to draw itself again, or regions of these types, such as the side bar
    ("UI")."""
    for region in regions(*kinds or ("WINDOW",)):
        region.tag_redraw()


def redraw_shot(scene: bpy.types.Scene, shot: Shot) -> None:
    """Asks the 3D views that show a shot to draw themselves again."""
    for _, area, space in _spaces_of(scene):
        if open_shots.showing(scene, camera_of(scene, space)) in {shot, None}:
            area.tag_redraw()


def settle() -> None:
    """Redraws the side bars twice: Blender puts panels below longer ones in their places one drawing later."""
    redraw("UI")
    if not bpy.app.background:
        bpy.app.timers.register(partial(redraw, "UI"), first_interval=SETTLE_SECONDS)
