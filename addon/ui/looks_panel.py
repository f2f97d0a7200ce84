"""The panel of looks, and the operators on them."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper, ImportHelper

from ..apply.writable import RefusedError
from ..core.looks import LookError
from ..core.usd.text import UsdError
from ..engine.native import NativeModuleError
from ..engine.reading import usd_files
from ..engine.shot import shot
from ..live import comparison
from ..viewport import compare as pairs
from . import looks, thumbnails
from .panel import RelumePanel

PROBLEMS = (LookError, RefusedError, UsdError, NativeModuleError, comparison.CompareError, OSError)


class _OnLook:
    """Mix-in of operators on the active look."""

    @classmethod
    def poll(cls, context):
        """True if there is a look."""
        return looks.active_look(context.scene) is not None


class RELUME_OT_snapshot(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Keep the rows and the lights as they are now as a look, with the picture"""

    bl_idname = "relume.snapshot"
    bl_label = "Snapshot"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        entry = looks.snapshot(context.scene)
        if shot.of(context.scene) is not None and not entry.thumbnail:
            self.report({"WARNING"}, f"{entry.name} has no thumbnail: the picture of these lights is not there yet")
        return {"FINISHED"}


class RELUME_OT_restore_look(_OnLook, bpy.types.Operator):  # noqa: N801
    """Put the rows back to this look"""

    bl_idname = "relume.restore_look"
    bl_label = "Restore Look"
    bl_options = {"REGISTER", "UNDO"}

    lights: BoolProperty(
        name="Lights Too",
        description="Write place, shape, energy and colour of the lights back into the scene as well",
        default=False,
        options={"SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context, properties):
        """The tooltip."""
        if properties.lights:
            return "Put the rows back, and write place, shape, energy and colour of the real lights too. One undo step"
        return "Put the rows back to this look. Writes nothing to the lights"

    def invoke(self, context, event):
        """Asks before it writes to lights."""
        if self.lights:
            return context.window_manager.invoke_confirm(self, event)
        return self.execute(context)

    def execute(self, context):
        """Called by Blender."""
        scene = context.scene
        try:
            outcome = looks.restore(scene, looks.active_look(scene).look(), self.lights)
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if str(outcome):
            self.report({"WARNING"}, str(outcome))
        return {"FINISHED"}


class RELUME_OT_delete_look(_OnLook, bpy.types.Operator):  # noqa: N801
    """Forget this look"""

    bl_idname = "relume.delete_look"
    bl_label = "Delete Look"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        looks.delete(context.scene, context.scene.relume_looks.active)
        return {"FINISHED"}


class RELUME_OT_export_look(_OnLook, ExportHelper, bpy.types.Operator):  # noqa: N801
    """Write this look to a JSON file that other cameras and files can use"""

    bl_idname = "relume.export_look"
    bl_label = "Export Look"
    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def execute(self, context):
        """Called by Blender."""
        try:
            looks.export_file(looks.active_look(context.scene).look(), Path(self.filepath))
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_import_look(ImportHelper, bpy.types.Operator):  # noqa: N801
    """Add a look from a JSON file. Its lights are found by name"""

    bl_idname = "relume.import_look"
    bl_label = "Import Look"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".json"
    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def execute(self, context):
        """Called by Blender."""
        try:
            _entry, outcome = looks.import_file(context.scene, Path(self.filepath))
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if outcome.missing:
            self.report({"WARNING"}, f"Not in this scene: {', '.join(outcome.missing)}")
        return {"FINISHED"}


def _warn(operator: bpy.types.Operator, warnings: list[str]) -> None:
    for words in warnings:
        operator.report({"WARNING"}, words[:1].upper() + words[1:])


class RELUME_OT_export_lights(ExportHelper, bpy.types.Operator):  # noqa: N801
    """Write the lights as the rows show them, or as this look does, to a text file of OpenUSD (UsdLux) for other \
programs"""

    bl_idname = "relume.export_lights"
    bl_label = "Export Lights (USD)"
    filename_ext = ".usda"
    filter_glob: StringProperty(default="*.usda;*.usd", options={"HIDDEN"})
    source: EnumProperty(
        name="Lights",
        description="What is written",
        items=(("PRESENT", "As Now", "Lights and rows as they are"), ("LOOK", "Of This Look", "Those of the look")),
        default="PRESENT",
    )
    for_blender: BoolProperty(
        name="Suns for Blender",
        description="Blender's own importer takes a sun for four times as strong and twice as large as other programs",
        default=False,
    )

    def execute(self, context):
        """Called by Blender."""
        scene, chosen = context.scene, looks.active_look(context.scene)
        if self.source == "LOOK" and chosen is None:
            self.report({"ERROR"}, "There is no look; take a snapshot, or write the lights as they are now")
            return {"CANCELLED"}
        try:
            look = chosen.look() if self.source == "LOOK" else looks.current(scene, scene.name)
            warnings = usd_files.write_file(scene, look, Path(self.filepath), self.for_blender)
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        _warn(self, warnings)
        return {"FINISHED"}


class RELUME_OT_import_lights(ImportHelper, bpy.types.Operator):  # noqa: N801
    """Add a look from the lights of a text file of OpenUSD (UsdLux). Lights Too writes them, and makes those that are \
not there"""

    bl_idname = "relume.import_lights"
    bl_label = "Import Lights (USD)"
    bl_options = {"REGISTER", "UNDO"}
    filename_ext = ".usda"
    filter_glob: StringProperty(default="*.usda;*.usd", options={"HIDDEN"})

    def execute(self, context):
        """Called by Blender."""
        try:
            _entry, warnings = looks.import_lights(context.scene, Path(self.filepath))
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        _warn(self, warnings)
        return {"FINISHED"}


class RELUME_OT_compare_looks(_OnLook, bpy.types.Operator):  # noqa: N801
    """Show this look as A beside the other one as B. Without another one, B is the present picture"""

    bl_idname = "relume.compare_looks"
    bl_label = "Compare"

    def execute(self, context):
        """Called by Blender."""
        scene = context.scene
        chosen = [looks.active_look(scene)]
        other = scene.relume_looks.items.get(scene.relume_looks.other)
        try:
            comparison.start(scene, chosen if other is None else [*chosen, other])
        except PROBLEMS as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_stop_comparing(bpy.types.Operator):  # noqa: N801
    """Show the present picture alone again"""

    bl_idname = "relume.stop_comparing"
    bl_label = "Stop Comparing"

    def execute(self, context):
        """Called by Blender."""
        comparison.stop(context.scene)
        return {"FINISHED"}


class RELUME_UL_looks(bpy.types.UIList):  # noqa: N801
    """Looks with their pictures; a double click renames"""

    def draw_item(self, _context, layout, _data, look, _icon, _active_data, _active_property):
        """Called by Blender."""
        number = thumbnails.icon(look.uid, look.thumbnail)
        icon = {"icon_value": number} if number else {"icon": "IMAGE_DATA"}
        layout.prop(look, "name", text="", emboss=False, **icon)


class RELUME_PT_looks(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Saved states of rows and lights"""

    bl_idname = "RELUME_PT_looks"
    bl_label = "Looks"
    bl_order = 20

    def draw(self, context):
        """Called by Blender."""
        layout, state = self.layout, context.scene.relume_looks
        layout.operator("relume.snapshot", icon="IMAGE_DATA")
        line = layout.row()
        line.template_list("RELUME_UL_looks", "", state, "items", state, "active", rows=4)
        buttons = line.column(align=True)
        buttons.operator("relume.delete_look", text="", icon="REMOVE")
        buttons.separator()
        buttons.operator("relume.import_look", text="", icon="IMPORT")
        buttons.operator("relume.export_look", text="", icon="EXPORT")
        line = layout.row(align=True)
        line.operator("relume.import_lights", text="Import USD", icon="IMPORT")
        line.operator("relume.export_lights", text="Export USD", icon="EXPORT")
        look = looks.active_look(context.scene)
        if look is not None:
            _draw_look(layout, context.scene, look)


def _draw_look(layout, scene, look) -> None:
    number = thumbnails.icon(look.uid, look.thumbnail)
    if number:
        layout.template_icon(number, scale=7.0)
    line = layout.row(align=True)
    if look.solved:
        line.operator("relume.apply_solved", icon="CHECKMARK")
    else:
        _draw_restore(line)
    column = layout.column(align=True)
    column.enabled = shot.of(scene) is not None
    column.prop_search(scene.relume_looks, "other", scene.relume_looks, "items", text="With", icon="IMAGE_DATA")
    line = column.row(align=True)
    line.operator("relume.compare_looks", text=f"Compare with {scene.relume_looks.other or 'Now'}")
    if pairs.pair_of(scene) is not None:
        line.operator("relume.stop_comparing", text="", icon="X")
        column.row(align=True).prop(scene.relume_view, "compare", expand=True)


def _draw_restore(line) -> None:
    line.operator("relume.restore_look", text="Restore", icon="RECOVER_LAST").lights = False
    line.operator("relume.restore_look", text="Lights Too").lights = True


CLASSES = (
    RELUME_OT_snapshot,
    RELUME_OT_restore_look,
    RELUME_OT_delete_look,
    RELUME_OT_export_look,
    RELUME_OT_import_look,
    RELUME_OT_export_lights,
    RELUME_OT_import_lights,
    RELUME_OT_compare_looks,
    RELUME_OT_stop_comparing,
    RELUME_UL_looks,
    RELUME_PT_looks,
)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds panel and operators."""
    _register()
    comparison.register()


def unregister():
    """Takes them away, and ends comparisons."""
    comparison.unregister()
    _unregister()
