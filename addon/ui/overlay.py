"""Settings of the overlay in the 3D view, `scene.relume_view`: its panel, and the line of the wipe."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty

from ..viewport import camera_frame, compare, handlers, overlay
from ..viewport.views import redraw
from .panel import RelumePanel

GRAB_PIXELS = 8.0
"""Distance from the wipe's line within which the mouse grabs it, at a resolution scale of 1."""


def _redraw(_settings, _context) -> None:
    redraw()


class RelumeView(bpy.types.PropertyGroup):
    """Kept in the .blend file."""

    shown: BoolProperty(
        name="Show Relit Picture",
        description="Show the relit picture in the camera's frame of every 3D view",
        default=True,
        update=_redraw,
    )
    opacity: FloatProperty(
        name="Opacity",
        description="How much the relit picture covers the view behind it",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_redraw,
    )
    wipe: BoolProperty(
        name="Wipe",
        description="Show the relit picture left of a line only, and the view behind it on the right",
        default=False,
        update=_redraw,
    )
    wipe_position: FloatProperty(
        name="Position",
        description="Where the line is, from the left to the right edge of the frame. It can be dragged in the view",
        default=0.5,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        update=_redraw,
    )
    compare: EnumProperty(
        name="Compare",
        description="How two looks are compared",
        items=[
            ("WIPE", "Wipe", "A left of a line, B on the right"),
            ("A", "A", "The first one"),
            ("B", "B", "The second one"),
            ("DIFFERENCE", "Diff", "How far they are from each other; black where they are the same"),
        ],
        default="WIPE",
        update=_redraw,
    )
    difference_gain: FloatProperty(
        name="Gain",
        description="How much the difference is made brighter",
        default=4.0,
        min=1.0,
        max=100.0,
        update=_redraw,
    )


class RELUME_GT_wipe(bpy.types.Gizmo):  # noqa: N801 -- Blender's naming
    """The wipe's line, to be dragged; it is drawn with the picture"""

    bl_idname = "RELUME_GT_wipe"

    def draw(self, context):
        """Called by Blender; `viewport.handlers` draws the line."""

    def test_select(self, context, location):
        """Called by Blender: 0 if the mouse is on the line, else -1."""
        scene, frame = context.scene, _frame(context)
        if frame is None or not frame.bottom <= location[1] <= frame.top:
            return -1
        reach = GRAB_PIXELS * context.preferences.system.ui_scale
        return 0 if abs(location[0] - overlay.split_of(scene, frame)) <= reach else -1

    def invoke(self, context, event):
        """Called by Blender when the mouse is pressed."""
        self.before = context.scene.relume_view.wipe_position
        return {"RUNNING_MODAL"}

    def modal(self, context, event, tweak):
        """Called by Blender while the mouse is dragged."""
        frame = _frame(context)
        if frame is not None:
            context.scene.relume_view.wipe_position = (event.mouse_region_x - frame.left) / frame.width
        return {"RUNNING_MODAL"}

    def exit(self, context, cancel):
        """Called by Blender at the end; Esc puts the line back."""
        if cancel:
            context.scene.relume_view.wipe_position = self.before


class RELUME_GGT_wipe(bpy.types.GizmoGroup):  # noqa: N801
    """Lets the wipe's line be dragged in the view"""

    bl_idname = "RELUME_GGT_wipe"
    bl_label = "Relume Wipe"
    bl_space_type = "VIEW_3D"
    bl_region_type = "WINDOW"
    bl_options = {"PERSISTENT", "SCALE"}

    @classmethod
    def poll(cls, context):
        """True where a line is drawn."""
        content = overlay.what_to_show(context.scene, context.space_data, context.region, context.region_data)
        return isinstance(content, overlay.Show) and content.split != overlay.NEVER

    def setup(self, context):
        """Called by Blender."""
        self.gizmos.new(RELUME_GT_wipe.bl_idname).use_draw_modal = True


def _frame(context) -> camera_frame.Rectangle | None:
    camera = camera_frame.camera_of(context.scene, context.space_data)
    return camera_frame.frame_of(context.scene, camera, context.region, context.region_data)


class RELUME_PT_overlay(RelumePanel, bpy.types.Panel):  # noqa: N801
    """How the relit picture is shown"""

    bl_idname = "RELUME_PT_overlay"
    bl_label = "Picture"
    bl_order = 1
    bl_options = {"DEFAULT_CLOSED"}

    def draw_header(self, context):
        """Called by Blender."""
        self.layout.prop(context.scene.relume_view, "shown", text="")

    def draw(self, context):
        """Called by Blender."""
        settings, layout = context.scene.relume_view, self.layout
        layout.active = settings.shown
        layout.prop(settings, "opacity", slider=True)
        if compare.pair_of(context.scene) is None:
            row = layout.row(align=True)
            row.prop(settings, "wipe", toggle=True)
            if settings.wipe:
                row.prop(settings, "wipe_position", slider=True)
            return
        layout.row(align=True).prop(settings, "compare", expand=True)
        if settings.compare == "WIPE":
            layout.prop(settings, "wipe_position", slider=True)
        elif settings.compare == "DIFFERENCE":
            layout.prop(settings, "difference_gain")


CLASSES = (RelumeView, RELUME_GT_wipe, RELUME_GGT_wipe, RELUME_PT_overlay)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds `scene.relume_view`, the panel, and the drawing in views."""
    _register()
    bpy.types.Scene.relume_view = PointerProperty(type=RelumeView)
    handlers.register()


def unregister():
    """Takes them away; values stay in the file."""
    handlers.unregister()
    del bpy.types.Scene.relume_view
    _unregister()
