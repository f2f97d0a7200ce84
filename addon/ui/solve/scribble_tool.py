"""The scribble brush: a tool of the 3D view's toolbar that paints goals in camera view."""

from __future__ import annotations

import json
from typing import Any

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, FloatVectorProperty, StringProperty

from ...core import strokes as core
from ...engine.solve.request import strokes_of
from ...engine.solve.stroke_shots import key_of, strokes_in
from ...viewport import compare as pairs
from ...viewport import strokes as drawing
from ...viewport.views import redraw
from .settings import COLOR_TEXT, MEANING_ITEMS

TOOL = "relume.scribble"
AFTERWARDS = "builtin.select_box"
NO_CAMERA_VIEW = (
    "Look through the camera of the scene or of a listed shot to paint what its picture should do (numpad 0)"
)
ERASE_ITEM = (core.ERASE, "Erase", "Takes away what was painted here", "X", 7)
LIGHTEST = 0.05
"""Least pressure of a pen."""

TARGET_MEANING = core.meaning(core.COLOR)
"""Meaning that the target's rectangle is drawn with: white light."""

_handle: Any = None


def add_stroke(scene: bpy.types.Scene, stroke: core.Stroke) -> None:
    """Keeps a stroke in the scene. Raises StrokeError if the scene's strokes cannot be read."""
    settings = scene.relume_solve
    settings.strokes = core.to_json((*core.from_json(settings.strokes), stroke))


def is_active(context: bpy.types.Context) -> bool:
    """True if the brush is the active tool."""
    tool = context.workspace.tools.from_space_view3d_mode("OBJECT", create=False) if context.workspace else None
    return tool is not None and tool.idname == TOOL and context.mode == "OBJECT"


class RELUME_OT_scribble(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Paint what the picture should do. Drag in the camera's frame; Alt for a straight line, right mouse erases"""

    bl_idname = "relume.scribble"
    bl_label = "Scribble"
    bl_options = {"REGISTER", "UNDO"}

    goal: EnumProperty(name="Goal", description="What the picture is to do here", items=[*MEANING_ITEMS, ERASE_ITEM])
    amount: FloatProperty(name="Amount", description="Stops or mireds", default=1.0, min=0.0, soft_max=10.0)
    color: FloatVectorProperty(name="Colour", description=COLOR_TEXT, subtype="COLOR", default=(1.0, 1.0, 1.0), min=0.0)
    radius: FloatProperty(name="Radius", description="Of the picture's height", default=0.05, min=0.001, max=1.0)
    strength: FloatProperty(name="Strength", description="How much it counts", default=1.0, min=0.01, max=1.0)
    points: StringProperty(name="Points", description="JSON: x, y and pressure each", options={"HIDDEN", "SKIP_SAVE"})
    erase: BoolProperty(name="Erase", description="Take away instead", options={"HIDDEN", "SKIP_SAVE"})
    shot: StringProperty(name="Shot", description="Key of the listed shot", options={"HIDDEN", "SKIP_SAVE"})

    def draw(self, _context):
        """Called by Blender for the panel of the last operation."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "goal")
        if self.goal in core.UNITS:
            layout.prop(self, "amount", text=core.UNITS[self.goal].capitalize())
        elif self.goal == core.COLOR:
            layout.prop(self, "color")
        layout.prop(self, "radius")
        layout.prop(self, "strength")

    def invoke(self, context, event):
        """Called by Blender: begins with the settings of the brush."""
        frame, shot = drawing.frame_in(context), key_of(context.scene, drawing.camera_in(context))
        if frame is None or shot is None:
            self.report({"WARNING"}, NO_CAMERA_VIEW)
            return {"CANCELLED"}
        self.shot = shot
        settings, self.frame, self.button = context.scene.relume_solve, frame, event.type
        brush = settings.brush()
        self.goal, self.amount = (core.ERASE, 0.0) if self.erase else (brush.goal, brush.amount)
        self.color, self.strength = brush.color, 1.0 if self.erase else settings.strength
        self.radius = settings.size * context.preferences.system.pixel_size / frame.height
        self.movement = []
        self._move(context, event)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Follows the mouse until its button is released; Esc forgets the stroke."""
        if event.type == "ESC":
            drawing.set_live(context.scene, None)
            redraw()
            return {"CANCELLED"}
        if event.type in {"MOUSEMOVE", "INBETWEEN_MOUSEMOVE"}:
            self._move(context, event)
        elif event.type == self.button and event.value == "RELEASE":
            self._move(context, event)
            self.points = json.dumps(self.movement)
            return self.execute(context)
        return {"RUNNING_MODAL"}

    def _move(self, context, event):
        place = drawing.place_of(self.frame, event.mouse_region_x, event.mouse_region_y)
        point = (*place, max(event.pressure if event.is_tablet else 1.0, LIGHTEST))
        # A straight line has its ends alone, with one pressure.
        self.movement = [*self.movement[:1], point] if event.alt else [*self.movement, point]
        aspect = self.frame.width / self.frame.height
        drawing.set_live(context.scene, self._stroke(core.thinned(self.movement, self.radius, aspect)))
        redraw()

    def _stroke(self, points) -> core.Stroke:
        meaning = core.meaning(self.goal, self.amount, self.color)
        return core.Stroke(
            meaning, round(self.radius, core.DIGITS), round(self.strength, core.DIGITS), points, self.shot
        )

    def execute(self, context):
        """Keeps the stroke of `points`."""
        drawing.set_live(context.scene, None)
        render = context.scene.render
        aspect = render.resolution_x * render.pixel_aspect_x / (render.resolution_y * render.pixel_aspect_y)
        try:
            points = core.thinned(json.loads(self.points), self.radius, aspect)
            # Kept strokes must be readable again.
            (stroke,) = core.from_json(core.to_json([self._stroke(points)]))
            add_stroke(context.scene, stroke)
        except (core.StrokeError, ValueError, TypeError, IndexError) as error:
            self.report({"ERROR"}, f"This stroke cannot be kept: {error}")
            return {"CANCELLED"}
        return {"FINISHED"}


def clear_strokes(scene: bpy.types.Scene) -> None:
    """Takes away all strokes."""
    scene.relume_solve.strokes = ""


class RELUME_OT_clear_strokes(bpy.types.Operator):  # noqa: N801
    """Take away all strokes"""

    bl_idname = "relume.clear_strokes"
    bl_label = "Clear Strokes"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """True if there are strokes."""
        return bool(context.scene.relume_solve.strokes)

    def execute(self, context):
        """Called by Blender."""
        clear_strokes(context.scene)
        return {"FINISHED"}


class RELUME_OT_pick_brush(bpy.types.Operator):  # noqa: N801
    """Take the scribble brush in hand, and look through the camera"""

    bl_idname = "relume.pick_brush"
    bl_label = "Scribble"

    @classmethod
    def poll(cls, context):
        """True in a 3D view, in object mode, with a camera."""
        return context.region_data is not None and context.mode == "OBJECT" and context.scene.camera is not None

    def execute(self, context):
        """Called by Blender."""
        context.region_data.view_perspective = "CAMERA"
        return bpy.ops.wm.tool_set_by_id(name=TOOL)


def draw_brush(layout, below, settings) -> None:
    """Draws the meaning of the brush, and `below` its amount, in the header or the panel."""
    layout.prop(settings, "meaning", text="")
    unit = core.UNITS.get(settings.meaning)
    if unit:
        below.prop(settings, unit)
    elif settings.meaning == core.COLOR:
        below.prop(settings, "color", text="")


class ScribbleTool(bpy.types.WorkSpaceTool):
    """The brush in the toolbar"""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Relume Scribble"
    bl_description = (
        "Paint on the camera's picture what it should do: brighter, darker, another colour, shadow, or stay as it is.\n"
        "Left mouse paints, right mouse erases, Alt draws straight, Ctrl draws a rectangle, F and Shift F set size and "
        "strength, Enter solves, Esc leaves"
    )
    bl_icon = "ops.generic.select_paint"
    bl_cursor = "PAINT_CROSS"
    bl_keymap = (
        (RELUME_OT_scribble.bl_idname, {"type": "LEFTMOUSE", "value": "PRESS"}, None),
        (RELUME_OT_scribble.bl_idname, {"type": "LEFTMOUSE", "value": "PRESS", "alt": True}, None),
        (RELUME_OT_scribble.bl_idname, {"type": "RIGHTMOUSE", "value": "PRESS"}, {"properties": [("erase", True)]}),
        ("relume.draw_rectangle", {"type": "LEFTMOUSE", "value": "PRESS", "ctrl": True}, None),
        *(
            (
                "wm.radial_control",
                {"type": "F", "value": "PRESS", "shift": shift},
                {"properties": [("data_path_primary", f"scene.relume_solve.{name}")]},
            )
            for name, shift in (("size", False), ("strength", True))
        ),
        ("relume.solve", {"type": "RET", "value": "PRESS"}, None),
        ("relume.solve", {"type": "NUMPAD_ENTER", "value": "PRESS"}, None),
        ("wm.tool_set_by_id", {"type": "ESC", "value": "PRESS"}, {"properties": [("name", AFTERWARDS)]}),
    )

    def draw_settings(context, layout, _tool):  # noqa: N805 -- Blender calls it without an instance
        """Called by Blender for the header."""
        settings = context.scene.relume_solve
        view = getattr(context.space_data, "region_3d", None)
        if view is not None and view.view_perspective != "CAMERA":
            layout.label(text="Strokes are painted in the camera's view", icon="INFO")
            return
        draw_brush(layout, layout, settings)
        layout.prop(settings, "size")
        layout.prop(settings, "strength", slider=True)
        layout.prop(settings, "show_strokes", text="", icon="HIDE_OFF" if settings.show_strokes else "HIDE_ON")
        layout.operator("relume.clear_strokes", text="", icon="TRASH")
        layout.operator("relume.solve", icon="LIGHT")

    def draw_cursor(context, _tool, xy):  # noqa: N805
        """Called by Blender while the mouse is over a view."""
        settings, pixel = context.scene.relume_solve, context.preferences.system.pixel_size
        drawing.draw_brush(xy, settings.size * pixel, settings.brush(), pixel)


def _draw() -> None:
    """Called by Blender for every 3D view, over everything else. Draws nothing over a comparison."""
    context = bpy.context
    settings = context.scene.relume_solve
    if not settings.show_strokes or not is_active(context):
        return
    frame, shot = drawing.frame_in(context), key_of(context.scene, drawing.camera_in(context))
    if shot is None:
        return
    is_current = drawing.camera_in(context) == context.scene.camera
    if frame is not None and (pairs.pair_of(context.scene) is None or drawing.is_painting(context.scene)):
        regions = settings.regions if is_current else ()
        rectangles = [(it.meaning(), tuple(it.rectangle)) for it in regions if it.kind == "RECTANGLE"]
        if is_current and settings.target is not None and settings.target_place.kind == "RECTANGLE":
            rectangles.append((TARGET_MEANING, tuple(settings.target_place.rectangle)))
        strokes = (*strokes_of(context.scene), *drawing.live_stroke(context.scene))
        drawing.draw(frame, strokes_in(context.scene, strokes, shot), rectangles)


CLASSES = (RELUME_OT_scribble, RELUME_OT_clear_strokes, RELUME_OT_pick_brush)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds operators, and where there is a window the tool and its drawing."""
    global _handle
    _register()
    if not bpy.app.background:
        bpy.utils.register_tool(ScribbleTool, after={"builtin.annotate"}, separator=True)
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def unregister():
    """Takes them away; the ordinary tool replaces an active brush."""
    global _handle
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
        _handle = None
        _put_down()
        bpy.utils.unregister_tool(ScribbleTool)
    drawing.free()
    _unregister()


def _put_down() -> None:
    for window in bpy.context.window_manager.windows:
        area = next((area for area in window.screen.areas if area.type == "VIEW_3D"), None)
        tool = window.workspace.tools.from_space_view3d_mode("OBJECT", create=False)
        if area is None or tool is None or tool.idname != TOOL:
            continue
        with bpy.context.temp_override(window=window, area=area, region=area.regions[-1]):
            bpy.ops.wm.tool_set_by_id(name=AFTERWARDS)
