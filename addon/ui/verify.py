"""Verify: the present picture against Cycles."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.app.handlers import persistent
from bpy.props import EnumProperty, IntProperty, PointerProperty

from ..core.progress import share_and_words
from ..engine.cycles import verify
from ..engine.shot import shot as shots
from ..engine.solve import solving
from ..engine.workers.process import NoCopyError
from ..export.light_tree import light_objects
from ..export.lights import name_of
from ..live import comparison, rows
from ..viewport import compare
from ..viewport.views import redraw
from .panel import RelumePanel, message

TICK_SECONDS = 0.25
WAITS = "Waits for the picture of the present lights"
VIEWS = {
    "WIPE": ("Wipe", "Cycles on the left, Relume on the right"),
    "A": ("Cycles", "The render by Cycles"),
    "B": ("Relume", "The picture that was verified"),
    "DIFFERENCE": ("Difference", "Where the two differ: from black (nothing) by blue, green and red to white"),
}

_waiting: set[int] = set()
"""Session uids of scenes that are verified as soon as their picture is there."""
_refused: dict[int, str] = {}
"""Reasons why scenes were not verified after all, by session uid."""


def ask(scene: bpy.types.Scene) -> None:
    """Starts verifying now, or as soon as the full-size picture of the present lights and rows is there."""
    cancel(scene.session_uid)
    if _is_on_its_way(scene):
        _waiting.add(scene.session_uid)
        _poll()
    else:
        start(scene)


def is_waiting(scene: bpy.types.Scene) -> bool:
    """True if a scene is verified as soon as its picture is there."""
    return scene.session_uid in _waiting


def cancel(scene_uid: int) -> None:
    """Ends and forgets the comparison of a scene, also one that waits."""
    _waiting.discard(scene_uid)
    _refused.pop(scene_uid, None)
    verify.close(scene_uid)


def start(scene: bpy.types.Scene) -> verify.Verification:
    """Renders the present lights and rows with Cycles, and compares. Raises VerifyError, NoCopyError or OSError."""
    shot, frame = shots.of(scene), _present_frame(scene)
    lights = [name_of(obj) for obj in light_objects(scene)]
    mix = rows.mix(scene, lights, shot.key)
    running = verify.start(scene, frame, shot.camera, scene.relume_verify.samples, mix)
    compare.clear(scene)
    _poll()
    return running


def _poll() -> None:
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, first_interval=TICK_SECONDS, persistent=True)


def _is_on_its_way(scene: bpy.types.Scene) -> bool:
    """True if a full-size picture of the present lights and rows is on its way."""
    shot = shots.of(scene)
    if shot is None or shot.frame is None or shot.refusal or solving.running(scene) or comparison.running(scene):
        return False
    frame = shot.present_frame
    return frame is None or frame.scale != 1


def _present_frame(scene: bpy.types.Scene) -> Any:
    """The picture of the present lights and rows. Raises VerifyError where there is none, or none yet."""
    shot = shots.of(scene)
    if shot is None or shot.frame is None:
        raise verify.VerifyError("there is no picture yet; press Start and wait for it")
    if shot.refusal:
        raise verify.VerifyError(f"the present lights have no picture: {shot.refusal}")
    if shot.present_frame is None:
        if solving.running(scene):
            raise verify.VerifyError("lights are being solved; wait for the end of that or cancel it, then verify")
        if comparison.running(scene):
            raise verify.VerifyError("looks are being compared; verify when both are there")
        raise verify.VerifyError("the picture of the present lights is on its way; verify it when it is there")
    return shot.present_frame


def show(scene: bpy.types.Scene, view: str) -> None:
    """Shows the result of a comparison in the overlay; one of VIEWS; anything else hides it."""
    verification = verify.of(scene)
    if verification is None or verification.result is None or view not in VIEWS:
        compare.clear(scene)
    elif view == "DIFFERENCE":
        compare.set_pair(scene, verification.difference, verification.difference, "A")
    else:
        compare.set_pair(scene, verification.reference, verification.ours, view, ("Cycles", "Relume"))


LEAST_CLAMPED = 0.0005
"""Share of the light that clamping takes from which on it is said."""


def words(verification: verify.Verification) -> str:
    """Result of a comparison in one sentence."""
    if verification.error:
        return f"Not verified: {verification.error}"
    if verification.result is None:
        return f"Cycles renders, {share_and_words(verification.stage)[1]}"
    error, noise, psnr, clamped = (verification.result[name] for name in ("error", "noise", "psnr", "clamped"))
    said = (
        f"Differs from Cycles by {100 * error:.1f} % on average ({psnr:.1f} dB). "
        f"Noise of Cycles itself: {100 * noise:.1f} %"
    )
    if clamped < LEAST_CLAMPED:
        return said
    return f"{said}. Both are without clamping, which takes {100 * clamped:.1f} % of this file's light"


def tick() -> bool:
    """Polls once; returns True if it is to be called again."""
    verify.close_gone()
    has_begun = _begin_waiting()
    running = verify.all_running()
    if any([verification.poll() for verification in running]) or has_begun:
        redraw("UI")
    return bool(running or _waiting)


def _begin_waiting() -> bool:
    """Begins comparisons whose picture has come; returns True if there were any."""
    scenes = {scene.session_uid: scene for scene in bpy.data.scenes}
    ready = [uid for uid in _waiting if uid not in scenes or not _is_on_its_way(scenes[uid])]
    for uid in ready:
        _waiting.remove(uid)
        try:
            if uid in scenes:
                start(scenes[uid])
        except (verify.VerifyError, NoCopyError, OSError) as error:
            _refused[uid] = str(error)
    return bool(ready)


def _timer() -> float | None:
    return TICK_SECONDS if tick() else None


@persistent
def _on_load_pre(*_arguments) -> None:
    """Another file is about to be opened."""
    _end()


def _end() -> None:
    _waiting.clear()
    _refused.clear()
    verify.close_all()


class RelumeVerifySettings(bpy.types.PropertyGroup):
    """Kept in the .blend file."""

    samples: IntProperty(
        name="Samples",
        description="Paths per pixel of the render by Cycles. More have less noise of their own, and take longer",
        default=128,
        min=2,
        soft_max=4096,
    )


class RELUME_OT_verify(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Render the present lights and rows with Cycles, in a Blender of its own, and compare: you can go on working"""

    bl_idname = "relume.verify"
    bl_label = "Verify"

    def execute(self, context):
        """Called by Blender."""
        try:
            # Without a window nothing would begin with what waits.
            (start if bpy.app.background else ask)(context.scene)
        except (verify.VerifyError, NoCopyError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_verify_cancel(bpy.types.Operator):  # noqa: N801
    """End the render by Cycles"""

    bl_idname = "relume.verify_cancel"
    bl_label = "Cancel"

    def execute(self, context):
        """Called by Blender."""
        cancel(context.scene.session_uid)
        return {"FINISHED"}


class RELUME_OT_verify_show(bpy.types.Operator):  # noqa: N801
    """Show the verified picture beside that of Cycles"""

    bl_idname = "relume.verify_show"
    bl_label = "Show"

    view: EnumProperty(
        name="View",
        description="What to show",
        items=[(name, *texts) for name, texts in VIEWS.items()] + [("LIVE", "Live", "Back to the live picture")],
    )

    @classmethod
    def description(cls, _context, properties):
        """The tooltip of each button."""
        return VIEWS[properties.view][1] if properties.view in VIEWS else "Back to the live picture"

    def execute(self, context):
        """Called by Blender."""
        show(context.scene, self.view)
        return {"FINISHED"}


class RELUME_PT_verify(RelumePanel, bpy.types.Panel):  # noqa: N801
    """The present picture against Cycles"""

    bl_idname = "RELUME_PT_verify"
    bl_label = "Verify"
    bl_order = 40
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        """True if a shot is open."""
        return shots.of(context.scene) is not None

    def draw(self, context):
        """Called by Blender."""
        layout, verification = self.layout, verify.of(context.scene)
        if is_waiting(context.scene) or (verification is not None and verification.is_running):
            share = share_and_words(verification.stage)[0] if verification is not None else 0.0
            layout.progress(factor=share, text=words(verification) if verification is not None else WAITS)
            layout.operator("relume.verify_cancel", icon="X")
            return
        row = layout.row(align=True)
        row.prop(context.scene.relume_verify, "samples")
        row.operator("relume.verify", icon="CHECKMARK")
        if refused := _refused.get(context.scene.session_uid):
            message(layout, f"Not verified: {refused}", icon="ERROR")
        if verification is None:
            return
        message(layout, words(verification), icon="ERROR" if verification.error else "NONE")
        if verification.result is not None:
            grid = layout.grid_flow(columns=2, align=True)
            for name, (label, _) in VIEWS.items():
                grid.operator("relume.verify_show", text=label).view = name
            layout.operator("relume.verify_show", text="Live").view = "LIVE"


CLASSES = (
    RelumeVerifySettings,
    RELUME_OT_verify,
    RELUME_OT_verify_cancel,
    RELUME_OT_verify_show,
    RELUME_PT_verify,
)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds panel and operators."""
    _register()
    bpy.types.Scene.relume_verify = PointerProperty(type=RelumeVerifySettings)
    bpy.app.handlers.load_pre.append(_on_load_pre)


def unregister():
    """Takes them away and ends all comparisons."""
    bpy.app.handlers.load_pre.remove(_on_load_pre)
    _end()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    del bpy.types.Scene.relume_verify
    _unregister()
