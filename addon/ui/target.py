"""The target picture: from a file, from an image of the .blend file, or from the clipboard."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
from bpy.app.handlers import persistent
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.background_call import run_in_thread
from ..core.bake_folder import size_of
from ..core.solve import SolveError
from ..engine.shot import shot
from ..engine.workers.pictures import Read, Reading, is_in_memory
from ..viewport import compare as pairs
from ..viewport.views import redraw
from . import timers
from .panel import message
from .start import ShotOperator

POLL_SECONDS = 0.05

NO_CLIPBOARD = (
    "The clipboard holds no picture that this Blender can take (under X11 it needs the program xclip); save it as a "
    "file and open that"
)
PNG = b"\x89PNG"
XCLIP_SECONDS = 1.0
"""How long the owner of the clipboard may take to answer. It never does if that is a Blender that waits in a script."""


def picture_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height that targets and masks are scaled to: those of the bake, or else of a render."""
    found, render = shot.of(scene), scene.render
    size = size_of(found.folder) if found is not None else None
    if size is not None:
        return size
    share = render.resolution_percentage / 100.0
    return max(round(render.resolution_x * share), 1), max(round(render.resolution_y * share), 1)


@dataclass(frozen=True)
class _Kept:
    key: tuple
    """What was read, and how."""
    reading: Reading


_readings: dict[int, _Kept] = {}
"""By scene."""
_waiting: dict[int, Iterator[None]] = {}
"""Scenes whose target is shown as soon as it is read."""


def look_at(scene: bpy.types.Scene) -> None:
    """Begins to read the scene's target, to say whether and how it can be one."""
    forget(scene.session_uid)
    settings = scene.relume_solve
    if settings.target is None:
        return
    size = picture_size(scene)
    reading = Reading(scene, settings.target, size, settings.target_colors)
    _readings[scene.session_uid] = _Kept(_key(scene, size), reading)
    _wake()


def reading_of(scene: bpy.types.Scene) -> Reading | None:
    """What is known of the scene's target."""
    kept, image = _readings.get(scene.session_uid), scene.relume_solve.target
    return kept.reading if kept and image is not None and kept.key[0] == image.session_uid else None


def awaited(scene: bpy.types.Scene) -> Generator[None, None, Read]:
    """Yields until the scene's target is read; anew, if it may be another picture by now. Raises SolveError."""
    kept, image = _readings.get(scene.session_uid), scene.relume_solve.target
    if kept is None or (kept.reading.is_done and is_in_memory(image)) or kept.key != _key(scene, picture_size(scene)):
        look_at(scene)
    reading = _readings[scene.session_uid].reading
    while reading.step():
        yield
    if reading.found is None:
        raise SolveError(reading.error or "The target became another one while it was read: solve again")
    return reading.found


def forget(uid: int) -> None:
    """Forgets the target of a scene, and ends reading it."""
    kept = _readings.pop(uid, None)
    if kept is not None:
        kept.reading.close()


def _key(scene: bpy.types.Scene, size: tuple[int, int]) -> tuple:
    """All that the light of a target depends on, apart from pixels that were painted."""
    image, view = scene.relume_solve.target, scene.view_settings
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    changed = path.stat().st_mtime_ns if path.is_file() else 0
    displayed = (view.view_transform, view.look, view.exposure, view.gamma, view.use_curve_mapping)
    return image.session_uid, path, changed, scene.relume_solve.target_colors, size, displayed


def _wake() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, first_interval=0.0)


def _timer() -> float | None:
    """Goes on with all that is read or waited for."""
    goes_on = False
    for kept in _readings.values():
        if not kept.reading.is_done:
            goes_on |= kept.reading.step()
            if kept.reading.is_done:
                redraw("UI")
    for uid, work in list(_waiting.items()):
        try:
            next(work)
            goes_on = True
        except (StopIteration, SolveError):  # Why not is in the panel.
            del _waiting[uid]
    return POLL_SECONDS if goes_on else None


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
    """The file in X11's clipboard, which Blender takes no pictures from."""
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
    found = yield from awaited(scene)
    for scene in (scene for scene in bpy.data.scenes if scene.session_uid == uid):
        pairs.set_pair(scene, frame_of(found.pixels), None, scene.relume_view.compare, ("Target", "Relit"))


def frame_of(pixels: np.ndarray) -> SimpleNamespace:
    """Scene-linear colours, top row first, as a frame of the overlay."""
    image = np.ones((*pixels.shape[:2], 4), np.float32)
    image[..., :3] = pixels[::-1]
    return SimpleNamespace(image=image, serial=0, scale=1)


def told(operator: bpy.types.Operator, work) -> set[str]:
    """Does an operator's work; what keeps it from being done is said."""
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
        return told(self, lambda: load(context.scene, self.filepath))


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
        """Only with a target."""
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
        """Only with an open shot and a target."""
        return super().poll(context) and context.scene.relume_solve.target is not None

    def execute(self, context):
        """Called by Blender."""
        work = show(context.scene)
        if bpy.app.background:
            return told(self, lambda: [time.sleep(POLL_SECONDS) for _ in work])
        _waiting[context.scene.session_uid] = work
        _wake()
        return {"FINISHED"}


def draw(layout, scene: bpy.types.Scene) -> None:
    """The target and how it is meant."""
    settings = scene.relume_solve
    line = layout.row(align=True)
    line.prop(settings, "target", text="")
    line.operator("relume.load_target", text="", icon="FILE_FOLDER")
    line.operator("relume.paste_target", text="", icon="PASTEDOWN")
    if settings.target is None:
        return
    line.operator("relume.clear_target", text="", icon="X")
    _draw_reading(layout, reading_of(scene))
    column = layout.column(align=True)
    column.prop(settings, "target_colors")
    column.prop(settings, "target_weight")
    column.prop(settings, "target_exposure")
    line = layout.row(align=True)
    line.operator("relume.show_target")
    if pairs.pair_of(scene) is not None:
        line.operator("relume.stop_comparing", text="", icon="X")


def _draw_reading(layout, reading: Reading | None) -> None:
    """Whether and how the target can be one."""
    if reading is None:
        return
    if not reading.is_done:
        message(layout, "Reading the picture", "SORTTIME")
    elif reading.found is None:
        message(layout, reading.error, "ERROR")
    else:
        message(layout, reading.found.words, "ERROR" if reading.found.is_doubtful else "CHECKMARK")


CLASSES = (RELUME_OT_load_target, RELUME_OT_paste_target, RELUME_OT_clear_target, RELUME_OT_show_target)


@persistent
def _forget_all(*_arguments) -> None:
    """Another file is about to be opened, or the add-on is disabled."""
    _waiting.clear()
    for uid in list(_readings):
        forget(uid)


def register():
    """Adds the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.app.handlers.load_pre.append(_forget_all)


def unregister():
    """Takes them away."""
    bpy.app.handlers.load_pre.remove(_forget_all)
    _forget_all()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
