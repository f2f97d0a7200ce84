"""Places with goals of their own: rectangles, masks, and where objects or materials are seen."""

from __future__ import annotations

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatVectorProperty

from ...core import strokes as core
from ...engine.solve.request import LEAST
from ...viewport import strokes as drawing
from ...viewport.views import redraw
from .scribble_tool import NO_CAMERA_VIEW
from .settings import MEANING_ITEMS, PLACE_ITEMS, RegionPlace, RelumeRegion

KIND_ITEMS = [item[:3] for item in PLACE_ITEMS if item[0] != "RECTANGLE"]
"""Places that are chosen; rectangles are drawn."""


def add_region(scene: bpy.types.Scene, kind: str) -> RelumeRegion:
    """Adds a region with the present meaning of the brush as its goal."""
    settings = scene.relume_solve
    region = settings.regions.add()
    region.kind, region.goal = kind, settings.meaning
    region.stops, region.mireds, region.color = settings.stops, settings.mireds, settings.color
    settings.region = len(settings.regions) - 1
    return region


def remove_region(scene: bpy.types.Scene) -> None:
    """Takes away the active region."""
    settings = scene.relume_solve
    settings.regions.remove(settings.region)
    settings.region = max(0, min(settings.region, len(settings.regions) - 1))


def draw_rectangle(
    scene: bpy.types.Scene, rectangle: tuple[float, float, float, float], goal: str, of_target: bool = False
) -> None:
    """Adds a rectangle (left, top, right, bottom) with a goal of the brush, or makes it where the target counts."""
    if of_target:
        place = scene.relume_solve.target_place
        place.kind, place.rectangle = "RECTANGLE", rectangle
        return
    region = add_region(scene, "RECTANGLE")
    region.rectangle, region.goal = rectangle, goal


class RELUME_OT_add_region(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Add a region with a goal of its own"""

    bl_idname = "relume.add_region"
    bl_label = "Add Place"
    bl_options = {"REGISTER", "UNDO"}

    kind: EnumProperty(name="Region", description="How the region is given", items=KIND_ITEMS)

    @classmethod
    def description(cls, _context, properties):
        """The tooltip."""
        return next((text for kind, _label, text, *_ in KIND_ITEMS if kind == properties.kind), cls.__doc__)

    def execute(self, context):
        """Called by Blender."""
        add_region(context.scene, self.kind)
        return {"FINISHED"}


class RELUME_OT_remove_region(bpy.types.Operator):  # noqa: N801
    """Take away this region"""

    bl_idname = "relume.remove_region"
    bl_label = "Remove Place"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """True if there are regions."""
        return len(context.scene.relume_solve.regions) > 0

    def execute(self, context):
        """Called by Blender."""
        remove_region(context.scene)
        return {"FINISHED"}


class RELUME_OT_draw_rectangle(bpy.types.Operator):  # noqa: N801
    """Draw a rectangle in the camera's frame that does what the brush means"""

    bl_idname = "relume.draw_rectangle"
    bl_label = "Draw Rectangle"
    bl_options = {"REGISTER", "UNDO"}

    rectangle: FloatVectorProperty(
        name="Rectangle", description="Left, top, right, bottom", size=4, options={"HIDDEN", "SKIP_SAVE"}
    )
    goal: EnumProperty(name="Goal", description="What the picture is to do there", items=MEANING_ITEMS)
    of_target: BoolProperty(
        name="Of the Target",
        description="It is where the target counts, not a region with a goal of its own",
        options={"HIDDEN", "SKIP_SAVE"},
    )

    @classmethod
    def description(cls, _context, properties):
        """The tooltip."""
        return "Draw in the camera's frame where the target counts" if properties.of_target else cls.__doc__

    def invoke(self, context, event):
        """Called by Blender: waits for the mouse from a button; with the brush, the drag has begun."""
        self.frame = drawing.current_frame_in(context)
        if self.frame is None:
            self.report({"WARNING"}, NO_CAMERA_VIEW)
            return {"CANCELLED"}
        self.goal = context.scene.relume_solve.meaning
        self.start = self._place(event) if event.value == "PRESS" and context.region.type == "WINDOW" else None
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Follows the mouse until its button is released."""
        if event.type in {"ESC", "RIGHTMOUSE"}:
            drawing.set_live(context.scene, None)
            redraw()
            return {"CANCELLED"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS" and self.start is None:
            self.start = self._place(event)
        elif event.type == "MOUSEMOVE" and self.start is not None:
            drawing.set_live(context.scene, self._outline(context, self._place(event)))
            redraw()
        elif event.type == "LEFTMOUSE" and event.value == "RELEASE" and self.start is not None:
            (x, y), (u, v) = self.start, self._place(event)
            self.rectangle = (min(x, u), min(y, v), max(x, u), max(y, v))
            return self.execute(context)
        return {"RUNNING_MODAL"}

    def _place(self, event) -> tuple[float, float]:
        place = drawing.place_of(self.frame, event.mouse_region_x, event.mouse_region_y)
        return tuple(min(max(value, 0.0), 1.0) for value in place)

    def _outline(self, context, end) -> core.Stroke:
        """Four sides of the rectangle as a thin stroke, while it is drawn."""
        (x, y), (u, v) = self.start, end
        corners = ((x, y), (u, y), (u, v), (x, v), (x, y))
        return core.Stroke(context.scene.relume_solve.brush(), LEAST, 1.0, tuple((*corner, 1.0) for corner in corners))

    def execute(self, context):
        """Adds the rectangle."""
        drawing.set_live(context.scene, None)
        left, top, right, bottom = self.rectangle
        if right - left < LEAST or bottom - top < LEAST:
            self.report({"WARNING"}, "Drag from one corner of the rectangle to the other")
            redraw()
            return {"CANCELLED"}
        draw_rectangle(context.scene, tuple(self.rectangle), self.goal, self.of_target)
        return {"FINISHED"}


class RELUME_UL_regions(bpy.types.UIList):  # noqa: N801
    """Places and their goals"""

    def draw_item(self, _context, layout, _data, region, _icon, _active_data, _active_property):
        """Called by Blender."""
        kind, goal = region.bl_rna.properties["kind"], region.bl_rna.properties["goal"]
        line = layout.row(align=True)
        line.label(text=kind.enum_items[region.kind].name, icon=kind.enum_items[region.kind].icon)
        line.label(text=goal.enum_items[region.goal].name, icon=goal.enum_items[region.goal].icon)


def draw(layout, scene: bpy.types.Scene) -> None:
    """Draws the list of places and the settings of the active one."""
    settings = scene.relume_solve
    line = layout.row(align=True)
    line.operator("relume.draw_rectangle", text="Rectangle", icon="SELECT_SET")
    line.operator_menu_enum("relume.add_region", "kind", text="Region", icon="ADD")
    if not settings.regions:
        return
    line = layout.row()
    line.template_list("RELUME_UL_regions", "", settings, "regions", settings, "region", rows=2)
    line.operator("relume.remove_region", text="", icon="REMOVE")
    if not 0 <= settings.region < len(settings.regions):
        return
    region = settings.regions[settings.region]
    column = layout.column(align=True)
    draw_place(column, region)
    column.prop(region, "goal")
    unit = core.UNITS.get(region.goal)
    if unit:
        column.prop(region, unit)
    elif region.goal == core.COLOR:
        column.prop(region, "color", text="")


def draw_place(column, place: RegionPlace) -> None:
    """Draws the settings of a region's place."""
    column.prop(place, "kind")
    name = {"MASK": "image", "OBJECT": "object", "MATERIAL": "material"}.get(place.kind)
    if name:
        column.prop(place, name, text="")
    elif place.kind.endswith("INDEX"):
        column.prop(place, "index")


CLASSES = (RELUME_OT_add_region, RELUME_OT_remove_region, RELUME_OT_draw_rectangle, RELUME_UL_regions)

register, unregister = bpy.utils.register_classes_factory(CLASSES)
