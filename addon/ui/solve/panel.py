"""Panels of solving."""

from __future__ import annotations

import json

import bpy

from ...core.rows import LIGHT
from ...core.strokes import Stroke
from ...engine.solve import solving
from ...engine.solve.request import strokes_of
from ...live import rows
from ...viewport import compare as pairs
from .. import looks
from ..panel import RelumePanel, message
from . import limits, locks, regions, scribble_tool, target

MORE_FREEDOM = "For more, let more change below: unlock places, loosen limits, or allow new lights"


class RELUME_PT_solve(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Lights that solve themselves"""

    bl_idname = "RELUME_PT_solve"
    bl_label = "Solve"
    bl_order = 15

    def draw(self, context):
        """Called by Blender."""
        layout, scene = self.layout, context.scene
        settings = scene.relume_solve
        column = layout.column(align=True)
        line = column.row(align=True)
        line.operator("relume.pick_brush", icon="BRUSH_DATA")
        scribble_tool.draw_brush(line, column, settings)
        strokes = strokes_of(scene)
        if strokes:
            line = layout.row(align=True)
            line.label(text=_count_of(strokes))
            line.prop(settings, "show_strokes", text="", icon="HIDE_OFF" if settings.show_strokes else "HIDE_ON")
            line.operator("relume.clear_strokes", text="", icon="TRASH")
        regions.draw(layout, scene)
        _draw_start(layout, scene)
        if settings.report:
            _draw_report(layout, scene)


def _count_of(strokes: tuple[Stroke, ...]) -> str:
    """Number of strokes, and of the shots that they are painted in if there are several."""
    shots = len({stroke.shot for stroke in strokes})
    words = "1 stroke" if len(strokes) == 1 else f"{len(strokes)} strokes"
    return words if shots == 1 else f"{words} in {shots} shots"


class RELUME_PT_solve_target(RelumePanel, bpy.types.Panel):  # noqa: N801
    """A picture to come close to"""

    bl_idname = "RELUME_PT_solve_target"
    bl_label = "Target Picture"
    bl_parent_id = "RELUME_PT_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, settings = self.layout, context.scene.relume_solve
        target.draw(layout, context.scene)
        if settings.target is None:
            return
        column = layout.column(align=True)
        regions.draw_place(column, settings.target_place)
        if settings.target_place.kind == "RECTANGLE":
            column.operator("relume.draw_rectangle", icon="SELECT_SET").of_target = True


class RELUME_PT_solve_locks(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Constraints of solving besides the locks of the rows, and how hard it tries"""

    bl_idname = "RELUME_PT_solve_locks"
    bl_label = "Constraints"
    bl_parent_id = "RELUME_PT_solve"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, settings = self.layout, context.scene.relume_solve
        locks.draw_all(layout)
        line = layout.row(align=True)
        line.prop(settings, "add_count")
        if settings.add_count:
            line.prop(settings, "add_type", text="")
        layout.prop(settings, "remove")
        limits.draw(layout, settings)
        layout.prop(settings, "stay", slider=True)
        layout.prop(settings, "keep_rest", slider=True)
        layout.prop(settings, "effort")


class RELUME_PT_solve_own_limits(RelumePanel, bpy.types.Panel):  # noqa: N801
    """How far the light whose row is chosen may go, where that is not as for all"""

    bl_idname = "RELUME_PT_solve_own_limits"
    bl_label = "Per-Light Constraints"
    bl_parent_id = "RELUME_PT_solve_locks"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, row = self.layout, rows.active_row(context.scene)
        if row is None or row.kind != LIGHT:
            layout.label(text="Choose a light in Lights, above", icon="INFO")
            return
        layout.label(text=f"{row.name}, in place of those of all", icon=row.icon)
        limits.draw(layout, row.locks, locks.kind_of(row))
        line = layout.row(align=True)
        line.prop(row.locks, "own_stay", text="")
        line = line.row(align=True)
        line.enabled = row.locks.own_stay
        line.prop(row.locks, "stay", slider=True)


def _draw_start(layout, scene: bpy.types.Scene) -> None:
    job = solving.running(scene)
    if job is not None:
        share, text = job.progress
        layout.progress(factor=share, text=text)
        layout.operator("relume.cancel_solve", icon="X")
        return
    line = layout.row()
    line.scale_y = 1.5
    line.operator("relume.solve", icon="LIGHT")


def _draw_report(layout, scene: bpy.types.Scene) -> None:
    """Draws the report of the last solve, the choice of picture, and the button that applies it."""
    report, box = json.loads(scene.relume_solve.report), layout.box()
    box.label(text=report["look"] + (", applied" if report.get("applied") else ""))
    for line in report["lines"]:
        message(box, line["text"], "CHECKMARK" if line["met"] else "ERROR")
    for note in report["notes"]:
        message(box, note, "INFO")
    if not all(line["met"] for line in report["lines"]):
        message(box, MORE_FREEDOM, "INFO")
    if pairs.pair_of(scene) is not None:
        line = box.row(align=True)
        line.prop(scene.relume_view, "compare", expand=True)
        line.operator("relume.stop_comparing", text="", icon="X")
    look = looks.active_look(scene)
    if look is not None and look.solved and not (report.get("applied") and look.name == report["look"]):
        box.operator("relume.apply_solved", text=f"Apply {look.name}", icon="CHECKMARK")


CLASSES = (
    RELUME_PT_solve,
    RELUME_PT_solve_target,
    RELUME_PT_solve_locks,
    RELUME_PT_solve_own_limits,
)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
