"""Lights that stand in one shot alone: a copy of a light, which is on there and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import bpy

from ..export.current_shot import current_entry
from ..export.lights import name_of
from ..live import rows
from ..live.scheduler import scheduler


class CopyError(ValueError):
    """A light cannot be copied; the message says why."""


def copy_for_shot(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """Copies the light of a row for the current shot, in which the copy is on and the light itself is off. Chooses the
    copy's row and selects the copy. Raises CopyError."""
    scene = context.scene
    entry, line = current_entry(scene), rows.line_of(scene, name)
    if entry is None or line is None:
        raise CopyError("choose a light, and a shot whose camera and frame the scene has")
    light, key = line.block, entry.key
    collections = [found for found in light.users_collection if found.is_editable]
    if not collections:
        raise CopyError(f"'{name}' is in no collection of this file; make it local first")
    copy = light.copy()
    copy.data = light.data.copy()
    copy.name = f"{light.name} {entry.name}"
    for collection in collections:
        collection.objects.link(copy)
    rows.sync(scene)
    by_name = {row.name: row for row in rows.present_rows(scene)}
    original, own = by_name[name], by_name[name_of(copy)]
    values = original.values(key)
    own.take(replace(original.values(), on=False, solo=False))
    rows.give_own_values(own, key, values)
    rows.give_own_values(original, key, replace(values, on=False))
    scene.relume_mix.active = list(scene.relume_mix.rows).index(own)
    for other in context.view_layer.objects.selected:
        other.select_set(False)
    copy.select_set(True)
    context.view_layer.objects.active = copy
    scheduler.read_lights(scene)
    return copy


class RELUME_OT_copy_for_shot(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Copy this light for the current shot, to be moved and changed there. The copy is off in all other shots, and the
    light itself is off in this one"""

    bl_idname = "relume.copy_for_shot"
    bl_label = "Copy for This Shot"
    bl_options = {"REGISTER", "UNDO"}

    light: bpy.props.StringProperty(name="Light", description="Name of the light object", options={"SKIP_SAVE"})

    def execute(self, context):
        """Called by Blender."""
        try:
            copy_for_shot(context, self.light)
        except CopyError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}
