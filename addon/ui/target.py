"""The target picture: from a file, from an image of the .blend file, or from the clipboard."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace

import bpy
import numpy as np
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from ..core.bake_folder import size_of
from ..core.solve import SolveError
from ..engine import shot
from ..export.target import TargetError, read_target
from ..viewport import compare as pairs
from .start import ShotOperator

NO_CLIPBOARD = (
    "The clipboard holds no picture that this Blender can take; copy one in a painting program, or open it as a file"
)


def picture_size(scene: bpy.types.Scene) -> tuple[int, int]:
    """Width and height that targets and masks are scaled to: those of the bake, or else of a render."""
    found, render = shot.of(scene), scene.render
    size = size_of(found.folder) if found is not None else None
    if size is not None:
        return size
    share = render.resolution_percentage / 100.0
    return max(round(render.resolution_x * share), 1), max(round(render.resolution_y * share), 1)


def read(scene: bpy.types.Scene) -> tuple[np.ndarray, str, bool]:
    """The scene's target, as `export.target.read_target` gives it. Raises SolveError."""
    settings = scene.relume_solve
    try:
        return read_target(scene, settings.target, settings.target_colors, picture_size(scene))
    except TargetError as error:
        raise SolveError(str(error)) from error


def choose(scene: bpy.types.Scene, image: bpy.types.Image) -> str:
    """Takes an image as the target, if it can be one; how its colours are understood. Raises SolveError."""
    settings = scene.relume_solve
    before, settings.target = settings.target, image
    try:
        _pixels, words, _doubt = read(scene)
    except SolveError:
        settings.target = before
        raise
    return words


def load(scene: bpy.types.Scene, path: str) -> str:
    """Takes a file as the target. Raises SolveError."""
    try:
        image = bpy.data.images.load(path, check_existing=True)
    except RuntimeError as error:
        raise SolveError(f"'{path}' cannot be opened as a picture") from error
    return choose(scene, image)


def paste(context: bpy.types.Context) -> str:
    """Takes the clipboard's picture as the target. Raises SolveError."""
    if bpy.app.background:
        raise SolveError("Pasting needs Blender's window")
    if not bpy.ops.image.clipboard_paste.poll():
        raise SolveError(NO_CLIPBOARD)
    before = set(bpy.data.images)
    try:
        with _image_editor(context):
            bpy.ops.image.clipboard_paste()
    except RuntimeError as error:
        raise SolveError(NO_CLIPBOARD) from error
    pasted = [image for image in bpy.data.images if image not in before]
    if not pasted:
        raise SolveError(NO_CLIPBOARD)
    return choose(context.scene, pasted[0])


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


def show(scene: bpy.types.Scene) -> None:
    """The target as A beside the live picture as B, in the camera's frame. Raises SolveError."""
    pairs.set_pair(scene, frame_of(read(scene)[0]), None, scene.relume_view.compare, ("Target", "Relit"))


def frame_of(pixels: np.ndarray) -> SimpleNamespace:
    """Scene-linear colours, top row first, as a frame of the overlay."""
    image = np.ones((*pixels.shape[:2], 4), np.float32)
    image[..., :3] = pixels[::-1]
    return SimpleNamespace(image=image, serial=0, scale=1)


def told(operator: bpy.types.Operator, work) -> set[str]:
    """Does an operator's work and says what came of it."""
    try:
        words = work()
    except SolveError as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    if words:
        operator.report({"INFO"}, words)
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


class RELUME_OT_paste_target(bpy.types.Operator):  # noqa: N801
    """Take the picture in the clipboard as the target"""

    bl_idname = "relume.paste_target"
    bl_label = "Paste Target"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context):
        """Called by Blender."""
        return told(self, lambda: paste(context))


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
        context.scene.relume_solve.target = None
        return {"FINISHED"}


class RELUME_OT_show_target(ShotOperator, bpy.types.Operator):  # noqa: N801
    """Show the target in the camera's frame beside the relit picture: by a wipe, one after the other, or as a \
difference"""

    bl_idname = "relume.show_target"
    bl_label = "Compare with Target"

    def execute(self, context):
        """Called by Blender."""
        return told(self, lambda: show(context.scene))


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
    column = layout.column(align=True)
    column.prop(settings, "target_colors")
    column.prop(settings, "target_weight")
    column.prop(settings, "target_exposure")
    line = layout.row(align=True)
    line.operator("relume.show_target")
    if pairs.pair_of(scene) is not None:
        line.operator("relume.stop_comparing", text="", icon="X")


CLASSES = (RELUME_OT_load_target, RELUME_OT_paste_target, RELUME_OT_clear_target, RELUME_OT_show_target)


def register():
    """Adds the operators."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)


def unregister():
    """Takes them away."""
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
