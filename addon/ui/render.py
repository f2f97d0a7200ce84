"""Relume as a render engine: F12 with passes, the viewport's shading "Rendered", and its settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
from bpy.props import BoolProperty, PointerProperty

from ..apply import compositor
from ..core.pass_names import LONGEST, STATIC, WORLD, light_passes, longest_in_file
from ..core.rows import LIGHT
from ..engine.reading import render_depsgraph
from ..engine.render import render_engine
from ..engine.render.data_passes import DataPassSettings, why_no_vector
from ..engine.render.render_engine import ENGINE, PassSettings
from ..engine.shot import shot as shots
from ..export.light_tree import light_tree
from ..export.lights import name_of
from ..live import rows
from ..live.scheduler import scheduler
from ..viewport import rendered
from ..viewport.views import pass_of
from . import render_pass

CYCLES_RENDER_PANELS = ("CYCLES_RENDER_PT_light_paths", "CYCLES_RENDER_PT_film", "CYCLES_RENDER_PT_simplify")
"""Panels of Cycles' render settings that concern a bake too; its other panels are for materials, lights and so on."""
CYCLES_VIEW_PANELS = "CYCLES_VIEW3D_PT_shading"
"""Panels of Cycles' own pictures in a view, which nothing of Relume follows."""
WITHOUT = ("CYCLES_RENDER_PT_light_paths_clamping",)

_own_sets: list[Any] = []
"""Panels that were given a set of engines of their own."""


class RelumeRenderSettings(bpy.types.PropertyGroup):
    """Kept in the .blend file."""

    light_passes: BoolProperty(
        name="Lights",
        description="A pass for each light, and for static light and world, to mix them in the compositor",
        default=True,
    )
    lobe_passes: BoolProperty(
        name="Lobes of Lights",
        description="Passes of each light by lobes, such as 'Diffuse Direct_Key', that add up to its pass. They hold "
        "light, not light divided by colour. Lights are summed over the bake's paths then",
        default=False,
    )


class RelumeRenderEngine(bpy.types.RenderEngine):
    """Relights the bake of the scene by its present lights and the rows; bakes first where there is none"""

    bl_idname = ENGINE
    bl_label = "Relume"
    bl_use_preview = False
    bl_use_eevee_viewport = True

    def render(self, depsgraph):
        """Called by Blender for each view layer of a final render, and where a scene is to be read."""
        if not render_depsgraph.run_waiting(self, depsgraph):
            render_engine.render(self, depsgraph, rows.mix, pass_settings)

    def update_render_passes(self, scene, renderlayer):
        """Called by Blender where passes become sockets of the compositor."""
        for name, channels, letters, kind in pass_settings(scene, renderlayer).declare(_light_names(scene)):
            self.register_pass(scene, renderlayer, name, channels, letters, kind)

    def view_update(self, context, depsgraph):
        """Called by Blender when the scene has changed; `live` follows the scene."""

    def view_draw(self, context, depsgraph):
        """Called by Blender to draw a view; computes nothing."""
        chosen = pass_of(context.space_data)
        if not rendered.draw(self, context, chosen):
            scheduler.wake()


def _light_names(scene: bpy.types.Scene) -> list[str]:
    """Names of the lights of a render. An open bake knows each instance; without one, each light counts once."""
    shot = shots.of(scene)
    known = [light["name"] for light in shot.lights.descriptions] if shot is not None else []
    shown = [line for line in light_tree(scene) if line.kind == LIGHT and (line.is_named or not line.block.hide_render)]
    return list(dict.fromkeys([*known, *(name_of(line.block) for line in shown)]))


def pass_settings(scene: bpy.types.Scene, layer: bpy.types.ViewLayer) -> PassSettings:
    """The passes that the artist has chosen for a view layer."""
    return PassSettings(
        longest=longest_in_file(layer.name) if bpy.app.version < (5, 0, 0) else LONGEST,
        lights=scene.relume_render.light_passes,
        lobes=scene.relume_render.lobe_passes,
        depth=layer.use_pass_z,
        normal=layer.use_pass_normal,
        albedo=layer.use_pass_diffuse_color,
        data=DataPassSettings.of(scene, layer),
        shadow_catcher=hasattr(layer, "cycles") and layer.cycles.use_pass_shadow_catcher,
    )


class RELUME_OT_set_up_compositing(bpy.types.Operator):  # noqa: N801
    """Add nodes to the compositor that rebuild the picture from the passes of its lights, each with an exposure and a
    tint. Other nodes stay as they are"""

    bl_idname = "relume.set_up_compositing"
    bl_label = "Set Up Compositing"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """True if this engine renders, with passes of lights."""
        if context.engine != ENGINE:
            cls.poll_message_set("Relume is not the render engine")
            return False
        if not context.scene.relume_render.light_passes:
            cls.poll_message_set("Passes of lights are switched off")
            return False
        return True

    def execute(self, context):
        """Called by Blender."""
        scene, layer = context.scene, context.view_layer
        longest = pass_settings(scene, layer).longest
        passes = [*light_passes(_light_names(scene), longest).values(), STATIC, WORLD]
        if not compositor.set_up(scene, layer, passes):
            self.report({"INFO"}, f"The compositor had nodes: link the image of '{compositor.GROUP}' where you want it")
        return {"FINISHED"}


class RELUME_PT_passes(bpy.types.Panel):  # noqa: N801 -- Blender's naming
    """Passes of a final render besides the picture"""

    bl_idname = "RELUME_PT_passes"
    bl_label = "Passes"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "view_layer"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """True if this engine renders."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        """Called by Blender."""
        layout, layer = self.layout, context.view_layer
        layout.use_property_split, layout.use_property_decorate = True, False
        column = layout.column(heading="Include")
        column.prop(context.scene.relume_render, "light_passes")
        lobes = column.column()
        lobes.active = context.scene.relume_render.light_passes
        lobes.prop(context.scene.relume_render, "lobe_passes")
        column.prop(layer, "use_pass_z", text="Depth")
        column.prop(layer, "use_pass_normal", text="Normal")
        column.prop(layer, "use_pass_diffuse_color", text="Diffuse Colour")
        if hasattr(layer, "cycles"):
            column.prop(layer.cycles, "use_pass_shadow_catcher", text="Shadow Catcher")
        column = layout.column(heading="Data")
        column.prop(layer, "use_pass_position", text="Position")
        column.prop(layer, "use_pass_uv", text="UV")
        vector = column.column()
        vector.active = not why_no_vector(context.scene)
        vector.prop(layer, "use_pass_vector", text="Vector")
        column.prop(layer, "use_pass_object_index", text="Object Index")
        column.prop(layer, "use_pass_material_index", text="Material Index")
        column.prop(layer, "pass_alpha_threshold")
        column = layout.column(heading="Cryptomatte")
        column.prop(layer, "use_pass_cryptomatte_object", text="Object")
        column.prop(layer, "use_pass_cryptomatte_material", text="Material")
        column.prop(layer, "use_pass_cryptomatte_asset", text="Asset")
        levels = layout.column()
        levels.active = any(DataPassSettings.of(context.scene, layer).mattes)
        levels.prop(layer, "pass_cryptomatte_depth", text="Levels")
        layout.operator(RELUME_OT_set_up_compositing.bl_idname, icon="NODE_COMPOSITING")


class RELUME_PT_sampling(bpy.types.Panel):  # noqa: N801
    """How clean a bake is that a final render has to make"""

    bl_idname = "RELUME_PT_sampling"
    bl_label = "Sampling"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {ENGINE}

    @classmethod
    def poll(cls, context):
        """True if this engine renders."""
        return context.engine in cls.COMPAT_ENGINES

    def draw(self, context):
        """Called by Blender."""
        layout, settings = self.layout, context.scene.relume
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(settings, "quality")
        if settings.quality == "CUSTOM":
            layout.prop(settings, "samples")
        layout.prop(settings, "folder")


CLASSES = (RelumeRenderSettings, RELUME_OT_set_up_compositing, RELUME_PT_sampling, RELUME_PT_passes)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)
END_SECONDS = 0.1


def register():
    """Adds the engine. Panels of Cycles show for it too, so that all properties stay at hand."""
    render_engine.stop_all(False)
    bpy.utils.register_class(RelumeRenderEngine)
    _register()
    render_depsgraph.standing = RelumeRenderEngine
    bpy.types.Scene.relume_render = PointerProperty(type=RelumeRenderSettings)
    _show_panels()
    if not bpy.app.background:  # Cycles may be enabled after this add-on.
        bpy.app.timers.register(_show_panels, first_interval=1.0)


def unregister():
    """Takes it away."""
    if bpy.app.timers.is_registered(_show_panels):
        bpy.app.timers.unregister(_show_panels)
    _hide_panels()
    del bpy.types.Scene.relume_render
    _unregister()
    render_depsgraph.standing = None
    render_engine.stop_all()
    if _end_engine() is not None:
        bpy.app.timers.register(_end_engine, first_interval=END_SECONDS, persistent=True)


def _end_engine() -> float | None:
    """Takes the engine itself away, once it does not render any more: Blender would crash."""
    if bpy.app.is_job_running("RENDER") and not bpy.app.background:
        return END_SECONDS
    if RelumeRenderEngine.is_registered:
        bpy.utils.unregister_class(RelumeRenderEngine)
    return None


def _show_panels() -> None:
    for panel in _panels():
        if "CYCLES" in panel.COMPAT_ENGINES and ENGINE not in panel.COMPAT_ENGINES and _is_wanted(panel):
            if "COMPAT_ENGINES" in panel.__dict__:
                panel.COMPAT_ENGINES.add(ENGINE)
            else:  # That of a mix-in would show all of its panels.
                panel.COMPAT_ENGINES = panel.COMPAT_ENGINES | {ENGINE}
                _own_sets.append(panel)


def _hide_panels() -> None:
    while _own_sets:
        del _own_sets.pop().COMPAT_ENGINES
    for panel in _panels():
        if panel not in (*CLASSES, *render_pass.CLASSES):
            panel.COMPAT_ENGINES.discard(ENGINE)


def _is_wanted(panel: Any) -> bool:
    name, context = panel.__name__, getattr(panel, "bl_context", "")
    if name.startswith(CYCLES_VIEW_PANELS):
        return False
    if name.startswith("CYCLES_") and context in {"render", "view_layer"}:
        return name.startswith(CYCLES_RENDER_PANELS) and name not in WITHOUT
    return "lightgroup" not in name and "FREESTYLE" not in name.upper()


def _panels(base: Any = bpy.types.Panel) -> Iterator[Any]:
    """All panels that say which engines they are for."""
    for panel in base.__subclasses__():
        if isinstance(getattr(panel, "COMPAT_ENGINES", None), set):
            yield panel
        yield from _panels(panel)
