"""The first panel: state of the shot, progress, and changes since the bake."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import bpy
from bpy.props import StringProperty

from ..core import status
from ..core.bake_folder import why_no_bake
from ..core.disk import free_space
from ..core.polled_cache import Key, PolledCache, Value
from ..core.words import Kind
from ..engine.shot import shot as shots
from ..engine.shot.checks import disk_space
from ..engine.shot.options import places_of_bake
from ..live import opening
from ..viewport import handlers as viewport
from ..viewport.views import redraw
from .panel import RelumePanel, message

DISK_SECONDS = 2.0
"""Seconds between reads of the disk: panels are drawn for every movement of the mouse."""
POLL_SECONDS = 0.1
"""Seconds between checks for the disk's answer."""
MOST_CHANGES = 6
"""Changes that are listed one by one."""
MOST_WARNINGS = 20
"""Most warnings in the list, and most names of one kind. Hundreds of lights can each have one, and every drawing lays
out the whole list."""


class RELUME_PT_main(RelumePanel, bpy.types.Panel):  # noqa: N801 -- Blender's naming
    """Start, progress, and a description of the picture"""

    bl_idname = "RELUME_PT_main"
    bl_label = "Relume"
    bl_order = 0

    def draw(self, context):
        """Called by Blender."""
        layout, scene = self.layout, context.scene
        shot = shots.of(scene)
        if context.space_data.region_3d.view_perspective != "CAMERA":  # The side bar has no region_data.
            layout.operator("relume.look_through_camera", icon="OUTLINER_DATA_CAMERA")
        if shot is not None:
            _draw_shot(layout, scene, shot)
        elif words := opening.why_not_open(scene):
            message(layout, words, "ERROR")
        if not _can_start_here(shot):
            return
        viewport.prepare(scene)
        _draw_stored_bake(layout, scene)
        _draw_choices(layout, scene)
        row = layout.row()
        row.scale_y = 1.5
        row.operator("relume.start", icon="PLAY")


def _can_start_here(shot: shots.Shot | None) -> bool:
    """True if the main panel has the button that starts: without a picture, starting comes first."""
    return shot is None or not (shot.is_working or shot.frame is not None or shot.is_busy)


class RELUME_PT_bake(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Bake again, better or elsewhere"""

    bl_idname = "RELUME_PT_bake"
    bl_label = "Bake"
    bl_parent_id = "RELUME_PT_main"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """True unless the panel around has the same buttons."""
        return not _can_start_here(shots.of(context.scene))

    def draw(self, context):
        """Called by Blender."""
        layout, shot = self.layout, shots.of(context.scene)
        _draw_choices(layout, context.scene)
        row = layout.row()
        row.enabled = not shot.is_working
        row.operator("relume.rebake", icon="FILE_REFRESH")
        if shot.status.live.device:
            layout.label(text=f"On {shot.status.live.device}")


_disk = PolledCache(DISK_SECONDS)


def on_disk(read: Callable[[Key], Value], key: Key) -> Value | None:
    """Value read from a disk; None until it is there, which redraws the panel."""
    value = _disk.get(read, key)
    if _disk.is_pending and not bpy.app.background and not bpy.app.timers.is_registered(_draw_disk_values):
        bpy.app.timers.register(_draw_disk_values, first_interval=POLL_SECONDS)
    return value


def _draw_disk_values() -> float | None:
    if _disk.is_pending:
        return POLL_SECONDS
    redraw("UI")
    return None


def _draw_stored_bake(layout, scene) -> None:
    places = places_of_bake(scene)
    problem = on_disk(why_no_bake, places) if places else None
    if problem == "":
        layout.operator("relume.show_bake", icon="HIDE_OFF")
    elif problem:
        box = layout.box()
        message(box, problem, "ERROR")
        box.operator("relume.find_bake", icon="FILE_FOLDER")


def _draw_choices(layout, scene) -> None:
    column = layout.column()
    column.prop(scene.relume, "quality")
    if scene.relume.quality == "CUSTOM":
        column.prop(scene.relume, "samples")
    place = "Beside the file" if bpy.data.filepath else "In the cache folder"
    column.prop(scene.relume, "folder", text="Folder", placeholder=place)
    words, is_enough = disk_space(scene, partial(on_disk, free_space))
    message(layout, words, "NONE" if is_enough else "ERROR")


def _draw_shot(layout, scene, shot: shots.Shot) -> None:
    state = shot.status
    message(layout, status.headline(state), "ERROR" if status.has_failed(state) else "NONE")
    if state.error and not status.has_failed(state):
        message(layout, status.error(state), "ERROR")
    progress = status.progress(state)
    if progress is not None:
        layout.progress(factor=progress[0], text=progress[1])
    if shot.is_working:
        row = layout.row(align=True)
        paused = state.live.paused
        if not shot.is_reading:
            row.operator("relume.pause", text="Resume" if paused else "Pause", icon="PLAY" if paused else "PAUSE")
        row.operator("relume.cancel", icon="X")
    elif status.is_unfinished(state):
        layout.operator("relume.go_on", icon="PLAY")
    # Below the buttons, which must not move under the mouse when it appears.
    if words := status.to_come(state):
        message(layout, words)
    if shot.frame is None and shot.picture is not None:
        message(layout, "Showing the bake before")
    elif status.shown(state):
        message(layout, status.shown(state))
    if shot.is_changing_world:
        message(layout, "Reading the world, which has changed")
    sentences = [*shot.changes.sentences, *status.out_of_sight(state)]
    if sentences:
        _draw_changes(layout, sentences)
    if shot.warnings_by_kind:
        _draw_warnings(layout, scene, shot.warnings_by_kind)


def _draw_changes(layout, sentences: list[str]) -> None:
    box = layout.box()
    box.label(text="Changed since the bake", icon="ERROR")
    _draw_some(box, sentences, MOST_CHANGES)
    box.operator("relume.rebake", icon="FILE_REFRESH")


def _draw_warnings(layout, scene, kinds: tuple[Kind, ...]) -> None:
    settings = scene.relume
    count = sum(max(len(kind.names), 1) for kind in kinds)
    icon = "DOWNARROW_HLT" if settings.show_warnings else "RIGHTARROW"
    row = layout.row()
    row.alignment = "LEFT"
    text = "1 warning" if count == 1 else f"{count} warnings"
    row.prop(settings, "show_warnings", text=text, icon=icon, emboss=False)
    if not settings.show_warnings:
        return
    opened = settings.open_warnings.split("\n")
    for kind in kinds[:MOST_WARNINGS]:
        _draw_kind(layout, kind, kind.title in opened)
    if len(kinds) > MOST_WARNINGS:
        layout.label(text=f"and {len(kinds) - MOST_WARNINGS} more")


def _draw_kind(layout, kind: Kind, is_open: bool) -> None:
    if not kind.names:
        message(layout, kind.title, "INFO")
        return
    row = layout.row(align=True)
    icon = "DISCLOSURE_TRI_DOWN" if is_open else "DISCLOSURE_TRI_RIGHT"
    row.operator("relume.unfold_warnings", text="", icon=icon).kind = kind.title
    message(row, kind.title)
    if is_open:
        _draw_some(layout, list(kind.names), MOST_WARNINGS, "BLANK1")


class RELUME_OT_unfold_warnings(bpy.types.Operator):  # noqa: N801
    """Show or hide the names that this is about"""

    bl_idname = "relume.unfold_warnings"
    bl_label = "Unfold Warnings"
    bl_options = {"INTERNAL"}
    kind: StringProperty(name="Kind", description="What the warnings say", options={"SKIP_SAVE"})

    def execute(self, context):
        """Called by Blender."""
        settings = context.scene.relume
        opened = list(filter(None, settings.open_warnings.split("\n")))
        opened.remove(self.kind) if self.kind in opened else opened.append(self.kind)
        settings.open_warnings = "\n".join(opened)
        return {"FINISHED"}


def _draw_some(layout, sentences: list[str], most: int, icon: str = "NONE") -> None:
    for sentence in sentences[:most]:
        message(layout, sentence, icon)
    if len(sentences) > most:
        layout.label(text=f"and {len(sentences) - most} more")


CLASSES = (RELUME_OT_unfold_warnings, RELUME_PT_main, RELUME_PT_bake)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds the panels."""
    _register()


def unregister():
    """Takes them away."""
    if bpy.app.timers.is_registered(_draw_disk_values):  # A disk may never answer.
        bpy.app.timers.unregister(_draw_disk_values)
    _unregister()
