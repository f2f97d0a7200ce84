"""Bakes on a farm: the job is written beside the file, and what the machines have made is brought home."""

from __future__ import annotations

import bpy

from ..engine.shot import farm
from ..engine.shot.background import BackgroundError, BackgroundJob
from ..engine.shot.checks import ProblemError, check_start
from ..engine.workers.process import NoCopyError
from . import background
from .panel import RelumePanel, message

FAILURES = (ProblemError, BackgroundError, NoCopyError, ValueError, OSError)
"""Exceptions that are told to the artist."""


def write(scene: bpy.types.Scene) -> BackgroundJob:
    """Writes the job of a scene as it is now, in a Blender of its own. Raises one of FAILURES."""
    if not bpy.data.filepath:
        raise ProblemError("The job lies beside the file: save the file first")
    check_start(scene, farm.job_folder(scene))
    return background.run(scene, farm.FarmWriting)


def bring_home(scene: bpy.types.Scene) -> BackgroundJob:
    """Checks what the machines have made, and shows the bake if it is complete. Raises one of FAILURES."""
    return background.run(scene, farm.FarmCollecting)


class RELUME_OT_farm_write(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Write what a farm needs to bake this shot into a folder beside the file: the scene, a plan of its parts, and a
    file that your farm takes. The machines need the program relume, and no Blender"""

    bl_idname = "relume.farm_write"
    bl_label = "Write Job"

    def execute(self, context):
        """Called by Blender."""
        return _told(self, write, context.scene)


class RELUME_OT_farm_collect(bpy.types.Operator):  # noqa: N801
    """Check what the machines of the farm have made, and show the bake if it is complete. Parts that are missing or
    damaged are named"""

    bl_idname = "relume.farm_collect"
    bl_label = "Bring Home"

    def execute(self, context):
        """Called by Blender."""
        return _told(self, bring_home, context.scene)


def _told(operator, work, scene):
    try:
        work(scene)
    except FAILURES as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    return {"FINISHED"}


class RELUME_PT_farm(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Bakes that other machines trace"""

    bl_idname = "RELUME_PT_farm"
    bl_label = "Farm"
    bl_order = 51
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, settings = self.layout, context.scene.relume
        layout.use_property_split = True
        column = layout.column()
        column.prop(settings, "farm_kind")
        column.prop(settings, "farm_frames")
        column.prop(settings, "farm_parts")
        row = layout.row(align=True)
        row.operator("relume.farm_write", icon="EXPORT")
        row.operator("relume.farm_collect", icon="IMPORT")
        job = background.background.of(context.scene)
        if isinstance(job, (farm.FarmWriting, farm.FarmCollecting)):
            if job.is_running:
                factor, text = background.progress(job)
                layout.progress(factor=factor, text=text)
            else:
                message(layout, job.error or job.done_words, "ERROR" if job.error else "CHECKMARK")


CLASSES = (RELUME_OT_farm_write, RELUME_OT_farm_collect, RELUME_PT_farm)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
