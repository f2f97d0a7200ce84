"""The target picture: from a file, from an image of the .blend file, or from the clipboard."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ...core.background_call import run_in_thread
from ...core.solve import SolveError
from ...engine.solve import target_image
from ...engine.workers.pictures import Reading
from ...viewport import compare as pairs
from ...viewport.views import redraw
from .. import timers
from ..panel import message
from ..start import ShotOperator

POLL_SECONDS = 0.05
NO_CLIPBOARD = (
    "The clipboard holds no picture that this Blender can take (under X11 it needs the program xclip); save it as a "
    "file and open that"
)
PNG = b"\x89PNG"
XCLIP_SECONDS = 1.0
"""Longest wait for the owner of the clipboard. A Blender that waits in a script never answers."""


_waiting: dict[int, Iterator[None]] = {}
"""Comparisons that wait for a target to be read, by the session uid of their scene."""


def load(scene: bpy.types.Scene, path: str) -> None:
    """Takes a file as the target. Raises SolveError."""
    try:
        scene.relume_solve.target = bpy.data.images.load(path, check_existing=True)
    except RuntimeError as error:
        raise SolveError(f"'{path}' cannot be opened as a picture") from error


def paste(context: bpy.types.Context) -> Generator[None, None, None]:
    """Yields until the clipboard has answered, then takes its picture as the target. Raises SolveError."""
    uid = context.scene.session_uid
    image = None if bpy.app.background else _pasted_by_blender(context)
    if image is None:
        contents = yield from run_in_thread(_png_by_xclip)
        image = _packed(contents) if contents else None
    if image is None:
        raise SolveError(NO_CLIPBOARD)
    for scene in (scene for scene in bpy.data.scenes if scene.session_uid == uid):
        scene.relume_solve.target = image


def _pasted_by_blender(context: bpy.types.Context) -> bpy.types.Image | None:
    if not bpy.ops.image.clipboard_paste.poll():
        return None
    before = set(bpy.data.images)
    try:
        with _image_editor(context):
            bpy.ops.image.clipboard_paste()
    except RuntimeError:  # It holds no picture.
        return None
    return next((image for image in bpy.data.images if image not in before), None)


def _png_by_xclip() -> bytes | None:
    """PNG file in X11's clipboard, which Blender takes no pictures from."""
    program = shutil.which("xclip")
    if program is None or not os.environ.get("DISPLAY"):
        return None
    command = (program, "-selection", "clipboard", "-target", "image/png", "-out")
    try:
        answer = subprocess.run(command, capture_output=True, timeout=XCLIP_SECONDS, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout if answer.stdout.startswith(PNG) else None


def _packed(contents: bytes) -> bpy.types.Image:
    """An image of the .blend file that holds a PNG itself. Blender takes a tenth of a second to open its first picture
    file; this opens none."""
    image = bpy.data.images.new("Clipboard.png", 1, 1)
    image.pack(data=contents, data_len=len(contents))
    image.source = "FILE"
    return image


def clear(scene: bpy.types.Scene) -> None:
    """Solves without a target; the image stays in the file."""
    scene.relume_solve.target = None


@contextmanager
def _image_editor(context: bpy.types.Context) -> Iterator[None]:
    """A context for operators of the image editor, which needs one on screen: for a moment, in the place of the
    smallest other area."""
    others = [area for area in context.screen.areas if area != context.area]
    if not others:
        raise SolveError("Pasting needs a second editor on screen, such as the outliner")
    area = min(others, key=lambda area: area.width * area.height)
    kind = area.ui_type
    area.ui_type = "IMAGE_EDITOR"
    try:
        with context.temp_override(area=area, region=area.regions[-1], space_data=area.spaces.active):
            yield
    finally:
        area.ui_type = kind


def show(scene: bpy.types.Scene) -> Iterator[None]:
    """Yields until the target is read, then shows it as A beside the live picture as B, in the camera's frame. Raises
    SolveError."""
    uid = scene.session_uid
    picture = yield from target_image.awaited(scene)
    for scene in (scene for scene in bpy.data.scenes if scene.session_uid == uid):
        pairs.set_pair(scene, frame_of(picture.pixels), None, scene.relume_view.compare, ("Target", "Relit"))


def frame_of(pixels: np.ndarray) -> SimpleNamespace:
    """Scene-linear colours, top row first, as a frame of the overlay."""
    image = np.ones((*pixels.shape[:2], 4), np.float32)
    image[..., :3] = pixels[::-1]
    return SimpleNamespace(image=image, serial=0, scale=1)


def _continue_waiting() -> float | None:
    """Continues all comparisons that wait; returns the seconds until the next call."""
    for uid, work in list(_waiting.items()):
        try:
            next(work)
        except (StopIteration, SolveError):  # Why not is in the panel.
            del _waiting[uid]
    return POLL_SECONDS if _waiting else None


def report_failure(operator: bpy.types.Operator, work: Callable[[], object]) -> set[str]:
    """Does an operator's work and reports why it failed."""
    try:
        work()
    except SolveError as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    return {"FINISHED"}


class RELUME_OT_load_target(ImportHelper, bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Open a picture as the target. Any size with the aspect of the camera's frame is scaled to it"""

    bl_idname = "relume.load_target"
    bl_label = "Open Target"
    bl_options = {"REGISTER", "UNDO"}

    filter_image: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_folder: bpy.props.BoolProperty(default=True, options={"HIDDEN"})
    filter_glob: StringProperty(default="", options={"HIDDEN"})

    def execute(self, context):
        """Called by Blender."""
        return report_failure(self, lambda: load(context.scene, self.filepath))


class RELUME_OT_paste_target(timers.WaitingOperator, bpy.types.Operator):  # noqa: N801
    """Take the picture in the clipboard as the target"""

    bl_idname = "relume.paste_target"
    bl_label = "Paste Target"
    bl_options = {"REGISTER", "UNDO"}
    failures = (SolveError,)

    def work(self, context):
        """See `timers.WaitingOperator`."""
        return paste(context)


class RELUME_OT_clear_target(bpy.types.Operator):  # noqa: N801
    """Solve without a target. The image stays in the file"""

    bl_idname = "relume.clear_target"
    bl_label = "No Target"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """True if there is a target."""
        return context.scene.relume_solve.target is not None

    def execute(self, context):
        """Called by Blender."""
        clear(context.scene)
        return {"FINISHED"}


class RELUME_OT_show_target(ShotOperator, bpy.types.Operator):  # noqa: N801
    """Show the target in the camera's frame beside the relit picture: by a wipe, one after the other, or as a \
difference"""

    bl_idname = "relume.show_target"
    bl_label = "Compare with Target"

    @classmethod
    def poll(cls, context):
        """True with an open shot and a target."""
        return super().poll(context) and context.scene.relume_solve.target is not None

    def execute(self, context):
        """Called by Blender."""
        work = show(context.scene)
        if bpy.app.background:
            return report_failure(self, lambda: [time.sleep(POLL_SECONDS) for _ in work])
        _waiting[context.scene.session_uid] = work
        if not bpy.app.timers.is_registered(_continue_waiting):
            bpy.app.timers.register(_continue_waiting, first_interval=0.0)
        return {"FINISHED"}


def draw(layout, scene: bpy.types.Scene) -> None:
    """Draws the target and its settings."""
    settings = scene.relume_solve
    line = layout.row(align=True)
    line.prop(settings, "target", text="")
    line.operator("relume.load_target", text="", icon="FILE_FOLDER")
    line.operator("relume.paste_target", text="", icon="PASTEDOWN")
    if settings.target is None:
        return
    line.operator("relume.clear_target", text="", icon="X")
    _draw_reading(layout, target_image.reading_of(scene))
    column = layout.column(align=True)
    column.prop(settings, "target_colors")
    column.prop(settings, "target_weight")
    column.prop(settings, "target_exposure")
    line = layout.row(align=True)
    line.operator("relume.show_target")
    if pairs.pair_of(scene) is not None:
        line.operator("relume.stop_comparing", text="", icon="X")


def _draw_reading(layout, reading: Reading | None) -> None:
    """Draws how the target was read, or why it cannot be one."""
    if reading is None:
        return
    if not reading.is_done:
        message(layout, "Reading the picture", "SORTTIME")
    elif reading.found is None:
        message(layout, reading.error, "ERROR")
    else:
        message(layout, reading.found.words, "ERROR" if reading.found.is_doubtful else "CHECKMARK")


CLASSES = (RELUME_OT_load_target, RELUME_OT_paste_target, RELUME_OT_clear_target, RELUME_OT_show_target)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def _redraw_panels() -> None:
    redraw("UI")


@persistent
def _forget_all(*_arguments) -> None:
    """Another file is about to be opened, or the add-on is disabled."""
    _waiting.clear()
    target_image.forget_all()


def register():
    """Adds the operators."""
    _register()
    target_image.listeners.append(_redraw_panels)
    bpy.app.handlers.load_pre.append(_forget_all)


def unregister():
    """Takes them away."""
    bpy.app.handlers.load_pre.remove(_forget_all)
    target_image.listeners.remove(_redraw_panels)
    _forget_all()
    if bpy.app.timers.is_registered(_continue_waiting):
        bpy.app.timers.unregister(_continue_waiting)
    _unregister()
