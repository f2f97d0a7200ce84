"""The page in Blender's preferences."""

import time
from collections.abc import Generator

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ..core import disk
from ..engine import devices
from ..engine.native import NativeModuleError
from ..engine.shot import cache
from ..engine.shot.checks import folders_in_use
from ..engine.shot.options import PACKAGE, cache_folder
from . import timers

POLL_SECONDS = 0.1

_contents: dict[str, tuple[int, int]] = {}
"""Bakes and bytes of the cache folder, by its path, as last counted."""
_messages: list[tuple[str, str]] = []
"""Messages of the last work on the cache folder: kinds of reports, and words."""

Work = Generator[None, None, list[tuple[str, str]]]
_work: Work | None = None
"""Work on the cache folder that goes on; returns its messages."""


def find_devices() -> Generator[None, None, str]:
    """Yields until this machine's graphics cards are known, which the field *Device* then suggests; returns a sentence
    about them. Raises NativeModuleError or RelumeError."""
    devices.look()
    while devices.is_looking():
        yield
    names = devices.names()[len(devices.ALWAYS) :]
    return f"Found {', '.join(names)}" if names else "Found no graphics card; the processor is used"


def count_cache() -> Work:
    """Counts the bakes in the cache folder and their bytes."""
    folder = cache_folder()
    _contents[str(folder)] = yield from cache.count(folder)
    return [("INFO", f"Counted {_size_in_words(str(folder))}")]


def clean_cache() -> Work:
    """Deletes the bakes in the cache folder but for those in use."""
    gone, problems = yield from cache.clean(cache_folder(), folders_in_use)
    yield from count_cache()
    return [*(("WARNING", problem) for problem in problems), ("INFO", f"Deleted {_bakes(gone)}")]


def begin(work: Work) -> None:
    """Begins work on the cache folder: a moment at a time, or without a window to its end."""
    global _work
    _work = work
    _messages.clear()
    if not bpy.app.background:
        bpy.app.timers.register(_timer, first_interval=0.0, persistent=True)
        return
    while step():
        time.sleep(POLL_SECONDS)


def step() -> bool:
    """Continues the work on the cache folder; returns True if more is to be done."""
    global _work
    if _work is None:
        return False
    try:
        next(_work)
        return True
    except StopIteration as end:
        _messages[:] = end.value
    except OSError as error:
        _messages[:] = [("ERROR", f"The cache folder cannot be read: {error}")]
    _work = None
    return False


def _timer() -> float | None:
    if step():
        return POLL_SECONDS
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "PREFERENCES":
                area.tag_redraw()
    return None


def _size_in_words(folder: str) -> str:
    """Bakes and size of the folder when it was last counted."""
    number, size = _contents[folder]
    return f"{_bakes(number)}, {disk.in_words(size)}"


def _bakes(number: int) -> str:
    return f"{number} {'bake' if number == 1 else 'bakes'}"


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
            row.label(text=_size_in_words(folder))
        row.operator("relume.count_cache", icon="FILE_REFRESH")
        row.operator("relume.clean_cache", icon="TRASH")
        if _work is not None:
            layout.label(text="Working on the cache folder; you can go on", icon="TIME")
        for kind, words in _messages:
            layout.label(text=words, icon="INFO" if kind == "INFO" else "ERROR")


class RELUME_OT_find_devices(timers.WaitingOperator, bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Look for graphics cards; they are then suggested in the field beside"""

    bl_idname = "relume.find_devices"
    bl_label = "Find Devices"
    failures = (NativeModuleError, RuntimeError)

    def work(self, _context):
        """See `timers.WaitingOperator`."""
        return find_devices()


class _OnCache:
    """Mix-in of operators on the cache folder: one at a time. With a window the page shows the messages."""

    @classmethod
    def poll(cls, _context):
        """While nothing else is done with it."""
        return _work is None

    def tell(self):
        """Reports the messages, if the work has ended."""
        for kind, words in _messages:
            self.report({kind}, words)
        return {"FINISHED"}


class RELUME_OT_count_cache(_OnCache, bpy.types.Operator):  # noqa: N801
    """See how many bakes the cache folder holds, and how large they are"""

    bl_idname = "relume.count_cache"
    bl_label = "Count"

    def execute(self, _context):
        """Called by Blender."""
        begin(count_cache())
        return self.tell()


class RELUME_OT_clean_cache(_OnCache, bpy.types.Operator):  # noqa: N801
    """Delete all bakes in the cache folder, but for those that are shown or made now. Bakes beside your files stay"""

    bl_idname = "relume.clean_cache"
    bl_label = "Clean Up"

    def invoke(self, context, event):
        """Called by Blender."""
        return context.window_manager.invoke_confirm(self, event)

    def execute(self, _context):
        """Called by Blender."""
        begin(clean_cache())
        return self.tell()


CLASSES = (RelumePreferences, RELUME_OT_find_devices, RELUME_OT_count_cache, RELUME_OT_clean_cache)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds the page."""
    _register()


def unregister():
    """Takes it away."""
    global _work
    _unregister()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    if _work is not None:
        _work.close()
        _work = None
    _contents.clear()
    _messages.clear()
