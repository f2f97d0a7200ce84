"""Settings of a solve that a scene keeps: the brush and its strokes, regions with goals, the target picture, locks,
limits and effort. `scene.relume_solve`, and `locks` of each row."""

from __future__ import annotations

import math

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from ...core import strokes as core
from ...core.solve import EFFORTS, PARAMETERS, SolveOptions
from ...engine.solve import target_image
from ...engine.solve.request import WHOLE
from ...viewport.views import redraw

MEANING_ITEMS = [
    (core.BRIGHTER, "Brighter", "More light here, by so many stops", "LIGHT_SUN", 0),
    (core.DARKER, "Darker", "Less light here, by so many stops", "SHADING_SOLID", 1),
    (core.COLOR, "This Colour", "Light of this tint here", "COLOR", 2),
    (core.WARMER, "Warmer", "Light of a lower colour temperature here", "ADD", 3),
    (core.COOLER, "Cooler", "Light of a higher colour temperature here", "FREEZE", 4),
    (core.SHADOW, "Shadow", "A shadow is to fall here: less light by so many stops", "GHOST_ENABLED", 5),
    (core.KEEP, "Keep", "Here the picture is to stay as it is", "LOCKED", 6),
]
PLACE_ITEMS = [
    ("RECTANGLE", "Rectangle", "A rectangle of the picture", "SELECT_SET", 0),
    ("MASK", "Mask", "An image: white is in, black is out", "IMAGE_ALPHA", 1),
    ("OBJECT", "Object", "Where an object is seen", "OBJECT_DATA", 2),
    ("MATERIAL", "Material", "Where a material is seen", "MATERIAL", 3),
    ("OBJECT_INDEX", "Object Index", "Where objects of a pass index are seen", "LINENUMBERS_ON", 4),
    ("MATERIAL_INDEX", "Material Index", "Where materials of a pass index are seen", "LINENUMBERS_ON", 5),
]


def _redraw(_settings, _context) -> None:
    redraw()


def _read_target(settings, _context) -> None:
    target_image.read(settings.id_data)


def _has_size(_settings, obj) -> bool:
    return max(obj.dimensions) > 0.0


STOPS_TEXT = "How much brighter or darker: one stop more is twice the light, one less is half"
MIREDS_TEXT = "How much warmer or cooler, in mireds: an orange gel of half strength is about 80"
COLOR_TEXT = "The tint of the light that is wanted"
STOPS = {"default": 1.0, "min": 0.0, "max": 32.0, "soft_max": 8.0, "step": 10, "precision": 2}
"""Settings of a limit in stops."""
METRES = {"subtype": "DISTANCE", "min": 0.01, "max": 1000.0, "soft_max": 10.0, "step": 1, "precision": 3}
"""Settings of a limit of sizes. Smaller lights are taken as this small."""
DEGREES = {"subtype": "ANGLE", "max": math.pi, "step": 100, "precision": 1}
"""Settings of a limit of angles."""
STAY = {
    "description": "How much lights are drawn to where and as strong as they are, beside the goals. 0: not at all",
    "subtype": "FACTOR",
    "default": 0.0,
    "min": 0.0,
    "max": 1.0,
    "precision": 3,
}
"""Settings of the weight that keeps lights at their present state."""


class LimitSettings:
    """Mix-in of the limits of free parameters."""

    box: PointerProperty(
        name="Within",
        description="What moves, new lights too, stays in the box around this object, unless it is outside of it "
        "already. Without one it may go a little beyond what the camera sees",
        type=bpy.types.Object,
        poll=_has_size,
    )
    limit_strength: BoolProperty(
        name="Limit Strength",
        description="Keep the strength of what is there, the world too, within some stops of what it is. What may not "
        "become dark is not switched off",
    )
    darker: FloatProperty(
        name="Darker",
        description="At most so many stops darker: one is half the light, 0 is never darker",
        **STOPS,
    )
    brighter: FloatProperty(
        name="Brighter",
        description="At most so many stops brighter: one is twice the light, 0 is never brighter",
        **STOPS,
    )
    limit_tint: BoolProperty(
        name="Limit Colour",
        description="Keep the colour of what is there, the world too, near what it is, and that of new lights near "
        "white",
    )
    tint: FloatProperty(
        name="Stops",
        description="By how many stops red, green and blue may at most drift apart from how they are: 0 keeps the "
        "colour, 1 is an orange or blue gel of half strength, 3 is nearly any colour",
        **STOPS,
    )
    limit_turn: BoolProperty(
        name="Limit Turning",
        description="Keep spots, area lights and suns pointing within an angle of where they point. New ones may point "
        "anywhere",
    )
    turn: FloatProperty(
        name="Angle",
        description="Largest angle between where it points now and then",
        default=math.radians(15.0),
        min=0.0,
        **DEGREES,
    )
    limit_size: BoolProperty(
        name="Limit Size",
        description="Keep the radius of points and spots and the sides of area lights, new ones too, within a range "
        "where size is free. Without it they may be as large as a part of what the camera sees",
    )
    smallest: FloatProperty(
        name="Smallest",
        description="Smallest radius or side. A light that is smaller may stay so",
        default=0.05,
        **METRES,
    )
    largest: FloatProperty(
        name="Largest", description="Largest radius or side. A light that is larger may stay so", default=1.0, **METRES
    )
    limit_sun: BoolProperty(
        name="Limit Sun Angle",
        description="Keep the angle of suns, new ones too, which makes their shadows soft, within a range where size "
        "is free",
    )
    sun_least: FloatProperty(
        name="Least",
        description="Least angle of a sun. One with less may stay so",
        default=math.radians(0.5),
        min=math.radians(0.3),
        **DEGREES,
    )
    sun_most: FloatProperty(
        name="Most",
        description="Largest angle of a sun. One with more may stay so",
        default=math.radians(10.0),
        min=math.radians(0.3),
        **DEGREES,
    )
    limit_cone: BoolProperty(
        name="Limit Cone",
        description="Keep the cones of spots, new ones too, within a range where they are free",
    )
    cone_least: FloatProperty(
        name="Least",
        description="Least spot size, from edge to edge. A spot with less may stay so",
        default=math.radians(20.0),
        min=math.radians(1.0),
        **DEGREES,
    )
    cone_most: FloatProperty(
        name="Most",
        description="Largest spot size, from edge to edge. A spot with more may stay so",
        default=math.radians(90.0),
        min=math.radians(1.0),
        **DEGREES,
    )


def _is_locked(locks: RelumeLocks) -> bool:
    return locks.held or not any(getattr(locks, name) for name in PARAMETERS)


def _set_locked(locks: RelumeLocks, locked: bool) -> None:
    """Locks or unlocks a light as a whole. Unlocked, it has the free parameters that it had before, or else those of
    a new row."""
    locks.held = locked
    if _is_locked(locks) and not locked:
        locks.color = locks.strength = True


def _is_world_locked(settings: RelumeSolve) -> bool:
    return not (settings.world_color or settings.world_strength)


def _set_world_locked(settings: RelumeSolve, locked: bool) -> None:
    settings.world_color = settings.world_strength = not locked


class RelumeLocks(LimitSettings, bpy.types.PropertyGroup):
    """Locks of a light's parameters, and its own limits. Strength and colour are free at first: that is what a
    lighting artist dials last and undoes most easily, while places are composed or have a reason in the set."""

    held: BoolProperty(name="Held", description="Locked as a whole, whatever else is free", options={"HIDDEN"})
    locked: BoolProperty(
        name="Lock",
        description="Whether solving leaves this light as it is. Unlocked, what is free of it may change, which is "
        "chosen below the list; a bold open lock says that some of it is locked",
        get=_is_locked,
        set=_set_locked,
    )
    position: BoolProperty(
        name="Position",
        description="Whether solving may move this light. Locked at first: a light's place is composed, or has a "
        "reason in the set",
    )
    direction: BoolProperty(
        name="Direction", description="Whether solving may turn this light. Locked at first: it was aimed at something"
    )
    size: BoolProperty(
        name="Size",
        description="Whether solving may make this light larger or smaller, which changes how soft its shadows are. "
        "Locked at first: softness is a choice of style",
    )
    cone: BoolProperty(
        name="Cone",
        description="Whether solving may change angle and blend of this spot. Locked at first: its edge was placed",
    )
    color: BoolProperty(
        name="Colour",
        description="Whether solving may tint this light. Free at first; used only if a goal is about colour",
        default=True,
    )
    strength: BoolProperty(
        name="Strength", description="Whether solving may dim or brighten this light. Free at first", default=True
    )
    own_stay: BoolProperty(
        name="Own", description="Draw this light to where and as strong as it is more or less than all"
    )
    stay: FloatProperty(name="Stay Close", **STAY)


class GoalAmount:
    """Mix-in of the amount or colour that a goal asks for."""

    stops: FloatProperty(
        name="Stops", description=STOPS_TEXT, default=1.0, min=0.05, max=10.0, soft_max=4.0, step=10, precision=2
    )
    mireds: FloatProperty(
        name="Mireds", description=MIREDS_TEXT, default=60.0, min=1.0, max=500.0, soft_max=200.0, step=500, precision=0
    )
    color: FloatVectorProperty(
        name="Colour", description=COLOR_TEXT, subtype="COLOR", default=(1.0, 0.6, 0.3), min=0.0, soft_max=1.0
    )

    def meaning_of(self, goal: str) -> core.Meaning:
        """Meaning of a goal, with its amount and colour."""
        return core.meaning(goal, getattr(self, core.UNITS.get(goal, ""), 0.0), self.color)


class RegionPlace:
    """Mix-in of a part of the picture; its `kind` says which of these values count."""

    rectangle: FloatVectorProperty(
        name="Rectangle",
        description="Left, top, right and bottom edge as fractions of the picture, from its top left corner",
        size=4,
        default=(0.25, 0.25, 0.75, 0.75),
        min=0.0,
        max=1.0,
        update=_redraw,
    )
    image: PointerProperty(name="Mask", description="The mask; any size of the picture's aspect", type=bpy.types.Image)
    object: PointerProperty(name="Object", description="The object", type=bpy.types.Object)
    material: PointerProperty(name="Material", description="The material", type=bpy.types.Material)
    index: IntProperty(name="Index", description="The pass index", default=1, min=0)


class RelumeRegion(GoalAmount, RegionPlace, bpy.types.PropertyGroup):
    """A region of the picture with a goal, other than strokes; kept in the .blend file."""

    kind: EnumProperty(name="Region", description="How the region is given", items=PLACE_ITEMS, update=_redraw)
    goal: EnumProperty(name="Goal", description="What the picture is to do there", items=MEANING_ITEMS, update=_redraw)

    def meaning(self) -> core.Meaning:
        """Goal that is asked of the region."""
        return self.meaning_of(self.goal)


class RelumeTargetPlace(RegionPlace, bpy.types.PropertyGroup):
    """Part of the picture where the target counts; kept in the .blend file."""

    kind: EnumProperty(
        name="Where",
        description="The part of the picture that is to come close to the target. The rest stays as much as Keep the "
        "Rest says",
        items=[(WHOLE, "Whole Picture", "Everywhere", "IMAGE_DATA", len(PLACE_ITEMS)), *PLACE_ITEMS],
        default=WHOLE,
        update=_redraw,
    )


class RelumeSolve(GoalAmount, LimitSettings, bpy.types.PropertyGroup):
    """Settings of a solve; kept in the .blend file."""

    meaning: EnumProperty(name="Brush", description="What the picture is to do where you paint", items=MEANING_ITEMS)
    size: IntProperty(
        name="Size",
        description="Radius of the brush in pixels of the screen (F in the view)",
        subtype="PIXEL",
        default=30,
        min=1,
        max=1000,
        soft_max=300,
    )
    strength: FloatProperty(
        name="Strength",
        description="How much a stroke counts beside the others (Shift F in the view)",
        subtype="FACTOR",
        default=1.0,
        min=0.01,
        max=1.0,
    )
    strokes: StringProperty(name="Strokes", description="All strokes, as JSON", options={"HIDDEN"}, update=_redraw)
    show_strokes: BoolProperty(
        name="Show Strokes",
        description="Draw strokes and rectangles over the picture",
        default=True,
        update=_redraw,
    )
    regions: CollectionProperty(type=RelumeRegion, name="Places", description="Places with goals, besides strokes")
    region: IntProperty(name="Region", description="The region whose settings are shown below")
    target: PointerProperty(
        name="Target",
        description="A picture that the shot is to come close to: a paint-over, or a photograph of the same framing",
        type=bpy.types.Image,
        update=_read_target,
    )
    target_colors: EnumProperty(
        name="Colours",
        description="What the colours of the target are",
        items=[
            (
                "AUTO",
                "Automatic",
                "PNG, JPEG and other pictures of 8 bits are as this scene's view transform would show them, others are "
                "scene-linear",
            ),
            (
                "VIEW",
                "As Displayed",
                "What this scene's view transform makes of light, such as a paint-over of a render",
            ),
            ("SRGB", "sRGB", "Plain sRGB without a view transform"),
            ("LINEAR", "Scene-Linear", "Light itself, as in an EXR"),
        ],
        update=_read_target,
    )
    target_exposure: BoolProperty(
        name="Any Exposure",
        description="Only the mood counts: the picture may become brighter or darker than the target as a whole",
    )
    target_weight: FloatProperty(
        name="Weight", description="How much the target counts beside strokes", default=1.0, min=0.01, max=100.0
    )
    target_place: PointerProperty(type=RelumeTargetPlace, name="Where", description="Where the target counts")
    world_color: BoolProperty(
        name="World Colour",
        description="Whether solving may tint the light of the world. Locked at first: it belongs to the place and the "
        "hour of the shot",
    )
    world_strength: BoolProperty(
        name="World Strength",
        description="Whether solving may dim or brighten the light of the world. Locked at first: it belongs to the "
        "place and the hour of the shot",
    )
    world_locked: BoolProperty(
        name="Lock World",
        description="Whether solving leaves the world as it is. Locked at first. Unlocked, its strength and colour may "
        "change; a bold open lock says that one of them is locked",
        get=_is_world_locked,
        set=_set_world_locked,
    )
    add_count: IntProperty(
        name="New Lights", description="So many lights may be added, at most", default=0, min=0, max=32, soft_max=8
    )
    add_type: EnumProperty(
        name="Type",
        description="What new lights are",
        items=[
            ("point", "Point", "Spheres", "LIGHT_POINT", 0),
            ("area", "Area", "Rectangles", "LIGHT_AREA", 1),
            ("spot", "Spot", "Cones", "LIGHT_SPOT", 2),
            ("sun", "Sun", "Parallel light from far away", "LIGHT_SUN", 3),
        ],
    )
    remove: BoolProperty(
        name="May Switch Off", description="Lights with something free that turn out to do nothing may be hidden"
    )
    stay: FloatProperty(name="Stay Close", **STAY)
    keep_rest: FloatProperty(
        name="Preserve Elsewhere",
        description="How much everything that no goal names is to stay as it is, beside the goals. 0: it may change as "
        "it likes",
        subtype="FACTOR",
        default=SolveOptions.keep_rest,
        min=0.0,
        max=1.0,
    )
    effort: EnumProperty(
        name="Effort",
        description="How many times it begins elsewhere, and how long it goes on",
        items=[
            (name, name.capitalize(), f"{starts} starts of at most {steps} steps")
            for name, (starts, steps) in EFFORTS.items()
        ],
        default="NORMAL",
    )
    report: StringProperty(name="Report", description="What the last solve reached, as JSON", options={"HIDDEN"})

    def brush(self) -> core.Meaning:
        """Meaning of the brush at present."""
        return self.meaning_of(self.meaning)


CLASSES = (RelumeLocks, RelumeRegion, RelumeTargetPlace, RelumeSolve)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds `scene.relume_solve`."""
    _register()
    bpy.types.Scene.relume_solve = PointerProperty(type=RelumeSolve)


def unregister():
    """Takes it away; values stay in the file."""
    del bpy.types.Scene.relume_solve
    _unregister()
