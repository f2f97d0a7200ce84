"""Pass that a 3D view shows in its shading "Rendered": kept by each view, chosen in the popover of its shading."""

from __future__ import annotations

import bpy
from bpy.props import EnumProperty, PointerProperty, StringProperty

from ..core.pass_names import ALBEDO, COMBINED, DEPTH, NORMAL, STATIC, WORLD, light_passes
from ..engine.render.render_engine import ENGINE
from ..engine.shot import shot as shots
from ..viewport.views import redraw

_shown_items: list[tuple[str, str, str, int]] = []
"""Items of the menu that is open: Blender itself keeps no Python text."""


def _items(_settings, context: bpy.types.Context | None) -> list[tuple[str, str, str, int]]:
    shot = shots.of(context.scene) if context is not None else None
    lights = light_passes(light["name"] for light in shot.lights.descriptions) if shot is not None else {}
    choices = [
        (COMBINED, "Combined", "The whole picture"),
        *((name, light, f"What light '{light}' alone gives") for light, name in lights.items()),
        (WORLD, "World", "What the world alone gives"),
        (STATIC, "Emissive Materials", "What the scene itself emits"),
        (DEPTH, "Depth", "How far surfaces are: black where the nearest is, white where the farthest is or none"),
        (NORMAL, "Normal", "Which way surfaces face in the world: x as red, y as green, z as blue"),
        (ALBEDO, "Diffuse Colour", "The colour of surfaces without any light"),
    ]
    _shown_items[:] = [(*choice, number) for number, choice in enumerate(choices)]
    return _shown_items


def _chosen(settings: RelumeShading) -> int:
    """A light that is gone, or has another name now, leaves the whole picture."""
    names = [item[0] for item in _items(settings, bpy.context)]
    return names.index(settings.name_of_pass) if settings.name_of_pass in names else 0


def _choose(settings: RelumeShading, number: int) -> None:
    settings.name_of_pass = _items(settings, bpy.context)[number][0]


def _redraw(_settings, _context) -> None:
    redraw()


class RelumeShading(bpy.types.PropertyGroup):
    """Kept by each 3D view in the .blend file."""

    name_of_pass: StringProperty(
        name="Name of Pass",
        description="The name of the pass, as final renders of Blender 5 have it: numbers of a menu would change with "
        "the lights",
        default=COMBINED,
        update=_redraw,
    )
    render_pass: EnumProperty(
        name="Render Pass",
        description="Which pass of the relit picture this view shows: all light, that of a single light, of the world "
        "or of emissive materials, or what surfaces are",
        items=_items,
        get=_chosen,
        set=_choose,
    )


class RELUME_PT_shading_pass(bpy.types.Panel):  # noqa: N801 -- Blender's naming
    """Which pass this view shows"""

    bl_idname = "RELUME_PT_shading_pass"
    bl_label = "Render Pass"
    bl_space_type = "VIEW_3D"
    bl_region_type = "HEADER"
    bl_parent_id = "VIEW3D_PT_shading"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """True if the view shows pictures of this engine."""
        return context.engine in cls.COMPAT_ENGINES and context.space_data.shading.type == "RENDERED"

    def draw(self, context):
        """Called by Blender."""
        self.layout.prop(context.space_data.shading.relume, "render_pass", text="")


CLASSES = (RelumeShading, RELUME_PT_shading_pass)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds the choice to all 3D views."""
    _register()
    bpy.types.View3DShading.relume = PointerProperty(type=RelumeShading)


def unregister():
    """Takes it away."""
    del bpy.types.View3DShading.relume
    _unregister()
