"""Property groups of the mix, `scene.relume_mix`; `live.rows` keeps them in step with the scene."""

from __future__ import annotations

from typing import Any

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

from ..core import rows as core
from ..core.rows import GROUP, LIGHT, STATIC, WORLD
from ..core.shots import AUTOMATIC
from ..live import rows
from ..live.scheduler import scheduler
from .solve.settings import RelumeLocks


def _edited(row: RelumeRow, _context: Any) -> None:
    if not rows.are_silent():
        scheduler.request_picture(row.id_data, interactive=True)


class _Dials:
    """Mix-in of property groups with the values that can differ between shots."""

    on: BoolProperty(
        name="On", description="Whether this light shines. Writes nothing to the scene", default=True, update=_edited
    )
    exposure: FloatProperty(
        name="Exposure",
        description="Brightness in stops: one more is twice the light",
        soft_min=-10.0,
        soft_max=10.0,
        min=-32.0,
        max=32.0,
        step=10,
        precision=2,
        update=_edited,
    )
    multiplier: FloatProperty(
        name="Multiplier",
        description="Brightness as a factor, besides the exposure",
        default=1.0,
        min=0.0,
        soft_max=10.0,
        max=1e6,
        step=5,
        precision=2,
        update=_edited,
    )
    color: FloatVectorProperty(
        name="Colour",
        description="Tint, besides the light's own colour",
        subtype="COLOR",
        default=(1.0, 1.0, 1.0),
        min=0.0,
        soft_max=1.0,
        update=_edited,
    )
    use_kelvin: BoolProperty(
        name="Kelvin",
        description="Tint by a colour temperature too. 6500 K is nearly white",
        update=_edited,
    )
    kelvin: FloatProperty(
        name="Temperature",
        description="Colour temperature in kelvin: low is warm, high is cool",
        default=6500.0,
        min=800.0,
        max=20000.0,
        soft_min=1000.0,
        soft_max=12000.0,
        step=5000,
        precision=0,
        update=_edited,
    )

    def dials(self) -> dict[str, Any]:
        """These values, by the names of `core.rows.Row`."""
        return {name: getattr(self, name) for name in core.DIALS} | {"color": tuple(self.color)}

    def take(self, values: core.Row) -> None:
        """Sets what an artist sets; asks for no picture."""
        rows.take(self, values)


class RelumeOwnValues(_Dials, bpy.types.PropertyGroup):
    """Values that a row has in one shot alone; kept in the .blend file."""

    shot: StringProperty(name="Shot", description="Key of the shot", options={"HIDDEN"})


class RelumeRow(_Dials, bpy.types.PropertyGroup):
    """One line of the mix; kept in the .blend file."""

    kind: EnumProperty(
        name="Kind",
        description="What the row stands for",
        items=[
            (LIGHT, "Light", "A light object"),
            (GROUP, "Group", "A collection with lights in it"),
            (WORLD, "World", "Light of the world"),
            (STATIC, "Emissive Materials", "Light of emissive materials"),
        ],
        options={"HIDDEN"},
    )
    uid: IntProperty(name="Session UID", description="Finds the light again under another name", options={"HIDDEN"})
    groups: StringProperty(name="Groups", description="Collections with this light, by line", options={"HIDDEN"})
    present: BoolProperty(name="Present", description="Whether the scene has this light now", options={"HIDDEN"})
    hidden: BoolProperty(name="Hidden", description="Whether renders or views lack this light", options={"HIDDEN"})
    named: BoolProperty(
        name="Named", description="Whether geometry nodes or particles may show this light itself", options={"HIDDEN"}
    )
    depth: IntProperty(name="Depth", description="Collections around this row that have a line", options={"HIDDEN"})
    single: BoolProperty(name="Single", description="Whether a collection has one light alone", options={"HIDDEN"})
    order: IntProperty(name="Order", description="Place in the list", options={"HIDDEN"})
    icon: StringProperty(name="Icon", description="Icon of the row", options={"HIDDEN"})
    open: BoolProperty(name="Open", description="Show the rows of this collection", default=True)
    solo: BoolProperty(
        name="Solo",
        description="Only soloed rows are seen; several can be. A soloed group is all of its lights",
        update=_edited,
    )
    locks: PointerProperty(type=RelumeLocks, name="Locks", description="What solving may change of this light")

    own: CollectionProperty(
        type=RelumeOwnValues, name="Own Values", description="Values in single shots", options={"HIDDEN"}
    )

    def values(self, shot: str = AUTOMATIC) -> core.Row:
        """The row as plain data, in the shot of a key; by default as in all shots that have no values of their own."""
        return core.Row(name=self.name, kind=self.kind, solo=self.solo, **self.shown(shot).dials())

    def shown(self, shot: str) -> _Dials:
        """The values in the shot of a key, to be drawn and set."""
        return rows.own_values(self, shot) or self


class RelumeMix(bpy.types.PropertyGroup):
    """All rows of a scene; kept in the .blend file."""

    rows: CollectionProperty(type=RelumeRow, name="Rows", description="Lights, collections, world, emissive materials")
    active: IntProperty(name="Row", description="The row whose details are shown below")
    search: StringProperty(
        name="Search", description="Show the rows with these words in their name", options={"TEXTEDIT_UPDATE"}
    )
    grouped: BoolProperty(name="Collections", description="Show lights below their collections", default=True)
    session: StringProperty(name="Session", description="Run of Blender that wrote the uids", options={"HIDDEN"})


CLASSES = (RelumeOwnValues, RelumeRow, RelumeMix)


_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds `scene.relume_mix`."""
    _register()
    bpy.types.Scene.relume_mix = PointerProperty(type=RelumeMix)


def unregister():
    """Takes it away; values stay in the file."""
    del bpy.types.Scene.relume_mix
    _unregister()
