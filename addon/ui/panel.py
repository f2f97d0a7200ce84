"""Tab "Relume" of the 3D view's sidebar, which has all panels."""

from __future__ import annotations

import bpy

from ..viewport.side_bar import characters, lines


class RelumePanel:
    """Mix-in of every panel; `bl_order` is the order of panels."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Relume"


def message(layout, text: str, icon: str = "NONE") -> None:
    """Text over as many lines as it needs: a label of Blender is cut off at the panel's edge."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    for number, line in enumerate(lines(text, characters(bpy.context.region, icon != "NONE"))):
        column.label(text=line, icon=icon if number == 0 else ("BLANK1" if icon != "NONE" else "NONE"))
