"""The panel of shots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ExportHelper

from ...core.bake_folder import is_bake
from ...core.status import has_failed
from ...engine.shot import background, open_shots, shot_list
from ...engine.shot.options import FolderError, bake_folder, places_of_bake
from ...export.current_shot import active_entry, entries, shot_camera
from ..background import progress
from ..main_panel import on_disk
from ..panel import RelumePanel, message
from . import lay_out, sheet
from .operators import PROBLEMS


class RELUME_UL_shots(bpy.types.UIList):  # noqa: N801 -- Blender's naming
    """Shots of the scene"""

    bl_idname = "RELUME_UL_shots"

    def draw_item(self, _context, layout, _data, entry, _icon, _active_data, _property, _index=0, _flag=0):
        """Called by Blender."""
        scene = entry.id_data
        row = layout.row(align=True)
        row.prop(entry, "on", text="", icon="HIDE_OFF" if entry.on else "HIDE_ON", emboss=False)
        body = row.row(align=True)
        body.active = entry.on
        split = body.split(factor=0.45, align=True)
        split.prop(entry, "name", text="", emboss=False)
        rest = split.row(align=True)
        camera = shot_camera(entry)
        if entry.is_foreign:
            rest.label(text=entry.camera_name, icon="FILE_FOLDER")
        else:
            name = camera.name if camera is not None else entry.camera_name or "none"
            rest.label(text=name, icon="CAMERA_DATA" if camera is not None else "ERROR")
        if entry.use_frame and not entry.is_foreign:
            frame = rest.row(align=True)
            frame.alignment = "RIGHT"
            frame.label(text=str(entry.frame))
        row.label(text="", icon=_mark(scene, entry))


def _mark(scene: bpy.types.Scene, entry: Any) -> str:
    """Icon for the state of a shot."""
    batch, opened = background.batch_of(scene), open_shots.by_key(scene, entry.key)
    if batch is not None and batch.is_running:
        if batch.job is not None and batch.job.present == entry.name:
            return "RENDER_ANIMATION"
        if any(waiting.key == entry.key for waiting, _ in batch.waiting):
            return "SORTTIME"
    if entry.key in _problems or _failure(scene, entry):
        return "ERROR"
    if opened is not None:
        if has_failed(opened.status):
            return "ERROR"
        if opened.is_working:
            return "RENDER_ANIMATION"
        if opened.changes.sentences:
            return "FILE_REFRESH"
    return "CHECKMARK" if _is_baked(scene, entry) else "BLANK1"


def _is_there(folder: Path) -> bool:
    """True for the folder of a bake, also as long as the disk has not answered."""
    return on_disk(is_bake, folder) is not False


def _is_baked(scene: bpy.types.Scene, entry: Any) -> bool:
    try:
        places = [*places_of_bake(scene, entry.key), bake_folder(scene, entry)]
    except FolderError:
        return False
    return any(on_disk(is_bake, place) for place in places)


_problems: dict[str, str] = {}
"""Faults of shots, by their keys, as the panel that is drawn has found: each line asks for them."""


def _failure(scene: bpy.types.Scene, entry: Any) -> str:
    batch = background.batch_of(scene)
    return batch.failures.get(entry.name, "") if batch is not None else ""


class RELUME_OT_contact_sheet(bpy.types.Operator):  # noqa: N801
    """Relight all shots that are on and baked by the present lights, and show them side by side as an image"""

    bl_idname = "relume.contact_sheet"
    bl_label = "Contact Sheet"

    @classmethod
    def poll(cls, context):
        """True if there is a list."""
        return len(context.scene.relume_shots.items) > 0

    def execute(self, context):
        """Called by Blender."""
        try:
            sheet.start(context.scene)
        except (*PROBLEMS, RuntimeError) as error:
            self.report({"ERROR"}, " ".join(str(error).split()))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_save_sheet(bpy.types.Operator, ExportHelper):  # noqa: N801
    """Write the contact sheet as a PNG"""

    bl_idname = "relume.save_sheet"
    bl_label = "Save Sheet"
    filename_ext = ".png"
    filter_glob: bpy.props.StringProperty(default="*.png", options={"HIDDEN"})

    @classmethod
    def poll(cls, _context):
        """True if there is a sheet."""
        return sheet.IMAGE in bpy.data.images

    def execute(self, _context):
        """Called by Blender."""
        try:
            sheet.save(bpy.data.images[sheet.IMAGE], Path(self.filepath))
        except OSError as error:
            self.report({"ERROR"}, f"'{self.filepath}' could not be written: {error.strerror or error}")
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_PT_shots(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Cameras and frames that are lit together"""

    bl_idname = "RELUME_PT_shots"
    bl_label = "Shots"
    bl_order = 5
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, scene = self.layout, context.scene
        if not entries(scene):
            message(layout, "One shot: the scene's camera. Add more to bake and compare several")
            _draw_adding(layout)
            return
        state = scene.relume_shots
        _problems.clear()
        _problems.update(shot_list.problems(scene, _is_there))
        row = layout.row()
        row.template_list("RELUME_UL_shots", "", state, "items", state, "active", rows=4)
        column = row.column(align=True)
        column.operator("relume.add_cameras", text="", icon="ADD")
        column.operator("relume.remove_shot", text="", icon="REMOVE")
        column.separator()
        column.operator("relume.move_shot", text="", icon="TRIA_UP").direction = "UP"
        column.operator("relume.move_shot", text="", icon="TRIA_DOWN").direction = "DOWN"
        layout.prop(state, "follow")
        if (entry := active_entry(scene)) is not None:
            _draw_entry(layout, scene, entry)
        _draw_adding(layout)
        _draw_baking(layout, scene)
        _draw_sheet(layout, scene)


def _draw_adding(layout) -> None:
    column = layout.column(align=True)
    row = column.row(align=True)
    row.operator("relume.add_cameras", icon="CAMERA_DATA")
    row.operator("relume.add_from_markers", text="From Markers", icon="MARKER_HLT")
    row = column.row(align=True)
    row.operator("relume.add_view_layers", text="View Layers", icon="RENDERLAYERS")
    row.operator("relume.add_bake", text="Add Bake...", icon="FILE_FOLDER")


def _draw_entry(layout, scene, entry) -> None:
    for words in (_problems.get(entry.key), _failure(scene, entry)):
        if words:
            message(layout, words[0].upper() + words[1:], "ERROR")
    if entry.is_foreign:
        message(layout, f"Bake in '{entry.folder}', which is never written to")
        return
    column = layout.column()
    column.use_property_split, column.use_property_decorate = True, False
    column.prop(entry, "camera")
    row = column.row(align=True, heading="Frame")
    row.prop(entry, "use_frame", text="")
    value = row.row(align=True)
    value.active = entry.use_frame
    value.prop(entry, "frame", text="")
    column.prop_search(entry, "layer", scene, "view_layers", icon="RENDERLAYERS")
    row = column.row(align=True, heading="Size")
    row.prop(entry, "use_size", text="")
    value = row.row(align=True)
    value.active = entry.use_size
    value.prop(entry, "width", text="")
    value.prop(entry, "height", text="")
    column.prop(entry, "quality")
    if entry.quality == "CUSTOM":
        column.prop(entry, "samples")
    column.prop(entry, "folder", placeholder="A folder of its own")
    if entry.use_size and not _has_shape_of_scene(scene, entry):
        message(layout, "The camera's frame in the view has the scene's shape; the picture is stretched there", "INFO")


def _has_shape_of_scene(scene, entry) -> bool:
    width, height = scene.render.resolution_x, scene.render.resolution_y
    return abs(entry.width * height - entry.height * width) <= max(width, height)


def _draw_baking(layout, scene) -> None:
    batch = background.batch_of(scene)
    if batch is None or not batch.is_running:
        layout.operator("relume.bake_all", icon="RENDER_STILL")
        return
    if batch.job is not None:
        number = batch.count - len(batch.waiting) + batch.job.ahead
        factor, text = progress(batch.job)
        layout.label(text=f"Shot {number} of {batch.count}: {batch.job.present}")
        row = layout.row(align=True)
        row.progress(factor=factor, text=text)
        row.operator("relume.stop_baking", text="", icon="X")


def _draw_sheet(layout, scene) -> None:
    layout.operator("relume.lay_out", icon="VIEW_CAMERA")
    row = layout.row(align=True)
    row.operator("relume.contact_sheet", icon="IMGDISPLAY")
    row.operator("relume.save_sheet", text="", icon="EXPORT")
    if (progress := sheet.progress(scene)) is not None:
        layout.progress(factor=progress[0], text=progress[1])
    if words := sheet.failure(scene):
        message(layout, words, "ERROR")


CLASSES = (RELUME_UL_shots, lay_out.RELUME_OT_lay_out, RELUME_OT_contact_sheet, RELUME_OT_save_sheet, RELUME_PT_shots)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds panel and operators."""
    _register()


def unregister():
    """Takes them away and ends what is being made."""
    sheet.close_all()
    _unregister()
