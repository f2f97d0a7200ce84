"""The page in Blender's preferences."""

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ..engine.options import PACKAGE


class RelumePreferences(bpy.types.AddonPreferences):
    """Which machine parts are used, and where bakes of unsaved files go."""

    bl_idname = PACKAGE

    device: StringProperty(
        name="Device",
        description="Where to compute: auto takes the best graphics card, else the processor; or cpu, gpu, or a part "
        "of a card's name",
        default="auto",
    )
    limit_gpu_memory: BoolProperty(
        name="Limit GPU Memory",
        description="Use no more of the graphics card's memory than this; larger shots are streamed",
        default=False,
    )
    gpu_memory: IntProperty(
        name="MiB", description="Graphics memory that Relume may use, in MiB", default=4096, min=256, soft_max=65536
    )
    threads: IntProperty(
        name="Threads",
        description="Processor threads that Relume may use; 0 for one a core",
        default=0,
        min=0,
        max=1024,
    )
    train_seconds: FloatProperty(
        name="Learning Time",
        description="How long a network learns each type of light, in seconds; 0 to show samples only",
        default=60.0,
        min=0.0,
        soft_max=600.0,
        precision=0,
    )
    cache_folder: StringProperty(
        name="Cache Folder",
        description="Where bakes of files that were never saved go; empty for Blender's folder of extension data",
        subtype="DIR_PATH",
    )

    open_bakes: BoolProperty(
        name="Open Bakes with Files",
        description="Show the bake of a file as soon as the file is opened",
        default=True,
    )

    def draw(self, _context):
        """Called by Blender."""
        layout = self.layout
        layout.use_property_split = True
        layout.prop(self, "device")
        row = layout.row(heading="Limit GPU Memory")
        row.prop(self, "limit_gpu_memory", text="")
        sub = row.row()
        sub.active = self.limit_gpu_memory
        sub.prop(self, "gpu_memory", text="MiB")
        layout.prop(self, "threads")
        layout.prop(self, "train_seconds")
        layout.prop(self, "open_bakes")
        layout.prop(self, "cache_folder")


def register():
    """Adds the page."""
    bpy.utils.register_class(RelumePreferences)


def unregister():
    """Takes it away."""
    bpy.utils.unregister_class(RelumePreferences)
