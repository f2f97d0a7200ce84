"""The bake of a shot in a Blender of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import bpy

from ..core.progress import share_and_words
from ..engine.native import NativeModuleError
from ..engine.shot import background, shot, shot_list
from ..engine.shot.checks import ProblemError, check_start
from ..engine.shot.options import FolderError, remember_bake
from ..engine.workers.process import NoCopyError
from ..export.current_shot import current_entry, entries
from ..viewport.views import redraw
from .panel import RelumePanel, message
from .start import open_bake

TICK_SECONDS = 0.25
STAGES = {
    "prepare": "Preparing",
    "trace": "Tracing",
    "references": "Pictures to compare with",
    "train": "Learning",
    "measure": "Measuring",
    "validate": "Checking",
}


def start(scene: bpy.types.Scene) -> background.BackgroundBake:
    """Bakes the scene as it is now. Raises ProblemError, BackgroundError or NoCopyError."""
    check_start(scene)
    job = background.start(scene)
    poll()
    return job


def run(
    scene: bpy.types.Scene, kind: Callable[[bpy.types.Scene], background.BackgroundJob]
) -> background.BackgroundJob:
    """Starts a job that is no bake, and follows it. Raises BackgroundError or NoCopyError."""
    job = background.start_other(scene, kind)
    poll()
    return job


def poll() -> None:
    """Polls from now on until all jobs have ended, in a window."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_timer):
        bpy.app.timers.register(_timer, first_interval=TICK_SECONDS, persistent=True)


def tick() -> bool:
    """Polls once and opens finished bakes; returns True if it is to be called again."""
    for job in background.all_jobs():
        if job.poll():
            redraw("UI")
            if job.done and (bake := job.bake) is not None:
                _open(job, bake)
    for batch in background.all_batches():
        if batch.poll():
            redraw("UI")
            if not batch.is_running:
                write_list(batch)
    return any(work.is_running for work in (*background.all_jobs(), *background.all_batches()))


def write_list(batch: background.Batch) -> None:
    """Writes the list of baked shots for other programs, where the scene is still open and has a list."""
    for scene in bpy.data.scenes:
        if scene.session_uid != batch.scene_uid or not entries(scene):
            continue
        try:
            shot_list.write_file(scene)
        except (OSError, FolderError) as error:
            batch.failures[shot_list.LIST_FILE] = f"the list of shots could not be written: {error}"


def _open(job: background.BackgroundJob, bake: Path) -> None:
    """Shows a finished bake in the file it came from, if that is still open and nothing else of the scene is shown."""
    key = job.wanted.key if isinstance(job, background.BackgroundBake) else ""
    for scene in bpy.data.scenes:
        if scene.session_uid != job.scene_uid:
            continue
        if key:
            remember_bake(scene, bake, key)
        if not _is_free(shot.of(scene), bake) or (key and not _is_current(scene, key)):
            continue
        try:
            remember_bake(scene, bake)
            open_bake(scene)
        except (NativeModuleError, RuntimeError, ValueError, OSError) as error:
            job.error = f"it could not be opened: {error}"


def _is_current(scene: bpy.types.Scene, key: str) -> bool:
    entry = current_entry(scene)
    return entry is not None and entry.key == key


def _is_free(opened: shot.Shot | None, bake: Path) -> bool:
    """True if a finished bake may replace the one that is shown of its scene."""
    return opened is None or (opened.folder == bake and not opened.is_working)


def _timer() -> float | None:
    return TICK_SECONDS if tick() else None


def progress(job: background.BackgroundJob) -> tuple[float, str]:
    """Share of the present stage that is done, and words for it."""
    stage = job.stage
    name = STAGES.get(stage["stage"], stage["stage"].capitalize())
    share, words = share_and_words(stage)
    return share, f"{name} {words}"


class RELUME_OT_background_start(bpy.types.Operator):  # noqa: N801 -- Blender's naming
    """Trace and learn this shot in a Blender of its own, from a copy of the file: you can go on working, or open
    another file. An interrupted bake of the same shot goes on"""

    bl_idname = "relume.background_start"
    bl_label = "Bake in Background"

    def execute(self, context):
        """Called by Blender."""
        try:
            start(context.scene)
        except (ProblemError, background.BackgroundError, NoCopyError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class RELUME_OT_background_cancel(bpy.types.Operator):  # noqa: N801
    """Stop the bake; what it has written stays, and the next start goes on from there"""

    bl_idname = "relume.background_cancel"
    bl_label = "Stop"

    number: bpy.props.IntProperty(name="Number", description="Which job of the list", options={"HIDDEN"})

    def execute(self, context):
        """Called by Blender."""
        jobs = background.all_jobs()
        if self.number >= len(jobs):
            return {"CANCELLED"}
        jobs[self.number].cancel()
        return {"FINISHED"}


class RELUME_PT_background(RelumePanel, bpy.types.Panel):  # noqa: N801
    """Bakes that run in a Blender of their own"""

    bl_idname = "RELUME_PT_background"
    bl_label = "Background"
    bl_order = 50
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Called by Blender."""
        layout, mine = self.layout, background.of(context.scene)
        if mine is None or not mine.is_running:
            layout.operator("relume.background_start", icon="TIME")
        for number, job in enumerate(background.all_jobs()):
            if job.is_running:
                layout.label(text=job.title)
                factor, text = progress(job)
                row = layout.row(align=True)
                row.progress(factor=factor, text=text)
                row.operator("relume.background_cancel", text="", icon="X").number = number
        if mine is not None and not mine.is_running:
            message(layout, mine.error or mine.done_words, "ERROR" if mine.error else "CHECKMARK")


CLASSES = (RELUME_OT_background_start, RELUME_OT_background_cancel, RELUME_PT_background)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register():
    """Adds panel and operators."""
    _register()


def unregister():
    """Takes them away and ends all bakes."""
    background.close_all()
    if bpy.app.timers.is_registered(_timer):
        bpy.app.timers.unregister(_timer)
    _unregister()
