"""The page in Blender's preferences."""

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ..core import bake_cache
from ..engine import devices
from ..engine.checks import folders_in_use
from ..engine.options import PACKAGE, cache_folder
from . import timers

POLL_SECONDS = 0.1

_contents: dict[str, tuple[int, int]] = {}
"""Bakes and bytes of the cache folder, by its path, as last counted."""


def count_cache() -> tuple[int, int]:
    """Bakes in the cache folder and their bytes."""
    folder = cache_folder()
    bakes = list(bake_cache.bakes_in(folder))
    _contents[str(folder)] = len(bakes), sum(bake_cache.size_of(bake) for bake in bakes)
    return _contents[str(folder)]


def clean_cache() -> tuple[int, list[str]]:
    """Deletes the bakes in the cache folder but for those in use. How many are gone, and problems in words."""
    outcome = bake_cache.remove(list(bake_cache.bakes_in(cache_folder())), folders_in_use())
    count_cache()
    return outcome


def _devices(_preferences, _context, typed: str) -> list[str]:
    return [name for name in devices.names() if typed.lower() in name.lower()] or devices.names()


class RelumePreferences(bpy.types.AddonPreferences):
    """Which machine parts are used, and where bakes of unsaved files go."""

    bl_idname = PACKAGE

    device: StringProperty(
        name="Device",
        description="Where to compute: auto takes the best graphics card, else the processor; or cpu, gpu, or a part "
        "of a card's name. Used from the next start on",
        default="auto",
        search=_devices,
    )
    limit_gpu_memory: BoolProperty(
        name="Limit GPU Memory",
        description="Use no more of the graphics card's memory than this; larger shots are streamed. The computer's "
        "own memory needs no limit: it holds the scene and about 1 GiB of pictures of lights; paths stay on the disk",
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
        description="How long a network learns each type of light; 0 to show samples only",
        default=60.0,
        min=0.0,
        soft_max=600.0,
        precision=0,
        unit="TIME_ABSOLUTE",
    )
    open_bakes: BoolProperty(
        name="Open Bakes with Files",
        description="Show the bake of a file as soon as the file is opened",
        default=True,
    )
    cache_folder: StringProperty(
        name="Cache Folder",
        description="Where bakes of files that were never saved go; empty for Blender's folder of extension data",
        subtype="DIR_PATH",
    )

    def draw(self, _context):
        """Called by Blender."""
        layout = self.layout
        layout.use_property_split = True
        row = layout.row(align=True)
        row.prop(self, "device")
        row.operator("relume.find_devices", text="", icon="FILE_REFRESH")
        row = layout.row(heading="Limit GPU Memory")
        row.prop(self, "limit_gpu_memory", text="")
        sub = row.row()
        sub.active = self.limit_gpu_memory
        sub.prop(self, "gpu_memory", text="MiB")
        layout.prop(self, "threads")
        layout.prop(self, "train_seconds")
        layout.prop(self, "open_bakes")
        layout.prop(self, "cache_folder")
        self._draw_cache(layout)

    def _draw_cache(self, layout) -> None:
        folder = str(cache_folder())
        row = layout.row()
        if folder in _contents:
            number, size = _contents[folder]
            row.label(text=f"{number} {'bake' if number == 1 else 'bakes'}, {bake_cache.in_words(size)}")
        row.operator("relume.count_cache", icon="FILE_REFRESH")
        row.operator("relume.clean_cache", icon="TRASH")


class RELUME_OT_find_devices(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Look for graphics cards; they are then suggested in the field beside"""

    bl_idname = "relume.find_devices"
    bl_label = "Find Devices"

    def execute(self, context):
        """Called by Blender."""
        devices.look()
        if bpy.app.background:
            return {"FINISHED"}
        self._timer = timers.begin(context, POLL_SECONDS)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, _context, event):
        """Called by Blender."""
        if event.type != "TIMER" or devices.is_looking():
            return {"PASS_THROUGH"}
        timers.end(self._timer)
        found = devices.names()[len(devices.ALWAYS) :]
        self.report({"INFO"}, f"Found {', '.join(found)}" if found else "Found no graphics card; the processor is used")
        return {"FINISHED"}


class RELUME_OT_count_cache(bpy.types.Operator):  # noqa: N801
    """See how many bakes the cache folder holds, and how large they are"""

    bl_idname = "relume.count_cache"
    bl_label = "Count"

    def execute(self, _context):
        """Called by Blender."""
        number, size = count_cache()
        self.report({"INFO"}, f"{number} bakes, {bake_cache.in_words(size)}")
        return {"FINISHED"}


class RELUME_OT_clean_cache(bpy.types.Operator):  # noqa: N801
    """Delete all bakes in the cache folder, but for those that are shown or made now. Bakes beside your files stay"""

    bl_idname = "relume.clean_cache"
    bl_label = "Clean Up"

    def invoke(self, context, event):
        """Called by Blender."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _context):
        """Called by Blender."""
        gone, problems = clean_cache()
        for problem in problems:
            self.report({"WARNING"}, problem)
        self.report({"INFO"}, f"Deleted {gone} {'bake' if gone == 1 else 'bakes'}")
        return {"FINISHED"}


CLASSES = (RelumePreferences, RELUME_OT_find_devices, RELUME_OT_count_cache, RELUME_OT_clean_cache)


def register():
    """Adds the page."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes it away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    _contents.clear()
