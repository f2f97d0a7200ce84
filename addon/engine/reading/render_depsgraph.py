"""A render-mode depsgraph, which Blender gives only to render engines: modifiers at render levels, objects that are
shown in renders only.

A scene is read in a render of a linked copy of it: the copy shares all objects and is never saved. The copy's engine is
the add-on's own one where that is registered, else a hidden one. So the scene, its picture and its render slots stay as
they are. In Blender's window the render is a job on a thread of its own; without a window it is done when the call
returns.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, Generic, TypeAlias, TypeVar

import bpy
from bpy.app.handlers import persistent

from ...export.camera import why_no_picture
from ...export.left_out import WITHOUT_EFFECTS
from ...export.stop import ExportCancelled, Stop
from ...export.view_layer import render_layer

Result = TypeVar("Result")
Work: TypeAlias = Callable[[bpy.types.RenderEngine, bpy.types.Depsgraph, Stop], Result]
"""Work with an engine in its render and with its depsgraph; the last argument says if it should stop."""

POLL_SECONDS = 0.01
SWITCH_SECONDS = 0.0002
"""Longest time that Blender's window waits for Python while the work runs on another thread. Python's own 5 ms add up
to a standstill, because every panel waits anew."""


class RelumeExportEngine(bpy.types.RenderEngine):
    """The hidden engine; draws nothing."""

    bl_idname = "RELUME_EXPORT"
    bl_label = "Relume (internal)"
    bl_use_preview = False

    def render(self, depsgraph):
        """Called by Blender, once."""
        run_waiting(self, depsgraph)


standing: type[bpy.types.RenderEngine] | None = None
"""The add-on's own engine while it is registered, whose `render` begins with `run_waiting`."""
_waiting: list[RenderTask[Any]] = []
"""Tasks that the next renders of their copies are to run."""
_copies: dict[int, RenderTask[Any] | None] = {}
"""Tasks by the session uids of their copies; None once a copy was read. Undo can bring a copy back that was
removed."""
_last_slot: int | None = None
"""Render slot of the last picture that Blender has rendered, if it is known."""


def run_waiting(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> bool:
    """Runs the task that waits for a depsgraph of this scene; returns True if the scene is a copy that is being
    read."""
    task = next((task for task in _waiting if task.copy_uid == depsgraph.scene.session_uid), None)
    if task is not None:
        _waiting.remove(task)
        task.run(engine, depsgraph)
    return depsgraph.scene.session_uid in _copies


class RenderTask(Generic[Result]):
    """Work with a render-mode depsgraph, and what came of it. Raises RuntimeError of a scene without a picture."""

    def __init__(self, scene: bpy.types.Scene, work: Work[Result]):
        if words := why_no_picture(scene):  # Blender would not say of which scene.
            raise RuntimeError(words)
        self.scene_name, self.layer_name = scene.name, render_layer(scene).name
        self.copy_uid: int | None = None
        self.work = work
        self.started = self.cancelled = False
        self.is_displaced = False
        """True if another render has taken the place of this one, such as F12."""
        self._outcome: list[Result] = []
        self._error: BaseException | None = None

    def run(self, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
        """Called by the engine. No exception leaves it: one would hang Blender before 5.0."""
        self.started = True
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_SECONDS)
        try:
            self._outcome.append(self.work(engine, depsgraph, lambda: self.cancelled or engine.test_break()))
        except BaseException as error:
            self._error = error
        finally:
            sys.setswitchinterval(before)

    def cancel(self) -> None:
        """Asks the work to end."""
        self.cancelled = True

    def result(self) -> Result:
        """Result of the work; raises its exception."""
        if self._error is not None:
            raise self._error
        if self._outcome:
            return self._outcome[0]
        if self.cancelled:
            raise ExportCancelled("cancelled")
        raise RuntimeError(
            f"Blender did not render scene '{self.scene_name}'; is a camera set, is a view layer enabled?"
        )


def with_render_depsgraph(scene: bpy.types.Scene, work: Work[Result]) -> Result:
    """Calls `work` with an engine, the depsgraph of the scene's present frame and first render layer, and a function
    that returns True if it should stop. Returns its result. Blender's window stands still meanwhile."""
    task = RenderTask(scene, work)
    with _engine() as engine, _copied(scene, task, engine) as copy, _render_slot(), _synchronised_layers(copy):
        # The copy is the context's scene, so that it keeps its own frame.
        with bpy.context.temp_override(scene=copy, view_layer=copy.view_layers[task.layer_name]):
            bpy.ops.render.render()
    return task.result()


def start_with_render_depsgraph(
    scene: bpy.types.Scene,
    work: Work[Result],
    done: Callable[[Result | None, BaseException | None], None],
) -> RenderTask[Result]:
    """Starts `with_render_depsgraph` and returns at once. `work` runs on another thread; `done` is called from
    Blender's event loop with its result or error."""
    if bpy.app.is_job_running("RENDER"):
        raise RuntimeError("Blender is rendering already; wait for its end or press Esc there")
    task = RenderTask(scene, work)
    around = ExitStack()
    try:
        copy = around.enter_context(_copied(scene, task, around.enter_context(_engine())))
        around.enter_context(_synchronised_layers(copy))
        with _no_render_window(), _render_slot(), bpy.context.temp_override(window=_window(scene)):
            bpy.ops.render.render("INVOKE_DEFAULT", scene=copy.name)
    except BaseException:
        around.close()
        raise

    def poll() -> float | None:
        if bpy.app.is_job_running("RENDER") or (not task.started and _is_invoked()):
            return POLL_SECONDS
        around.close()
        _finish(task, done)
        return None

    bpy.app.timers.register(poll, first_interval=POLL_SECONDS, persistent=True)
    return task


def _finish(task: RenderTask[Result], done: Callable[[Result | None, BaseException | None], None]) -> None:
    if not task.started:  # Stopped before it began.
        task.cancel()
    try:
        result = task.result()
    except BaseException as error:
        done(None, error)
    else:
        done(result, None)


def _is_invoked() -> bool:
    """True if a render was asked for: Blender starts its job a moment later."""
    windows = bpy.context.window_manager.windows
    return any(operator.bl_idname == "RENDER_OT_render" for window in windows for operator in window.modal_operators)


def _window(scene: bpy.types.Scene) -> bpy.types.Window:
    """A window that shows the scene: a render takes the frame of its window's scene."""
    windows = bpy.context.window_manager.windows
    return next((window for window in windows if window.scene == scene), windows[0])


@contextmanager
def _engine() -> Iterator[str]:
    """Name of the engine that reads."""
    if standing is not None:
        yield standing.bl_idname
        return
    # A RenderEngine class left registered crashes Blender 4.2 at exit and hangs 4.5.
    bpy.utils.register_class(RelumeExportEngine)
    try:
        yield RelumeExportEngine.bl_idname
    finally:
        bpy.utils.unregister_class(RelumeExportEngine)


@contextmanager
def _copied(scene: bpy.types.Scene, task: RenderTask[Any], engine: str) -> Iterator[bpy.types.Scene]:
    """A linked copy of a scene, whose render runs the task: with that engine, of the task's view layer alone."""
    copy = scene.copy()
    copy.is_runtime_data = True  # Files that are saved meanwhile are without it.
    for layer in copy.view_layers:
        layer.use = layer.name == task.layer_name
    render = copy.render
    render.use_single_layer = False  # Blender would wait 0.2 s before it begins.
    for name, value in WITHOUT_EFFECTS.items():
        setattr(render, name, value)
    if render.engine != engine:  # Blender begins all views anew, also those of other scenes.
        render.engine = engine
    task.copy_uid = copy.session_uid
    _copies[task.copy_uid] = task
    _waiting.append(task)
    try:
        yield copy
    finally:
        if task in _waiting:
            _waiting.remove(task)
        _copies[task.copy_uid] = None
        remove_copies()


def remove_copies() -> None:
    """Removes copies of scenes that are not being read. To be called after undo, which can bring them back."""
    for scene in list(bpy.data.scenes):
        if _copies.get(scene.session_uid, ...) is None:
            bpy.data.scenes.remove(scene)


@persistent
def on_render_init(scene: bpy.types.Scene, *_arguments) -> None:
    """Remembers the slot of a picture that Blender begins to render, and which readings had to end for it."""
    global _last_slot
    image = _render_result()
    _last_slot = image.render_slots.active_index if image is not None else None
    for uid, task in _copies.items():
        if task is not None and uid != scene.session_uid:
            task.is_displaced = True


@contextmanager
def _render_slot() -> Iterator[None]:
    """Context in which a render may begin without loss of a picture. Blender empties the active render slot, unless the
    last picture is in it."""
    image = _render_result()
    if image is None or _last_slot is None or _last_slot >= len(image.render_slots):
        yield
        return
    before = image.render_slots.active_index
    image.render_slots.active_index = _last_slot
    try:
        yield
    finally:
        image.render_slots.active_index = before


def _render_result() -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.type == "RENDER_RESULT"), None)


@contextmanager
def _synchronised_layers(scene: bpy.types.Scene) -> Iterator[None]:
    """Context in which a scene's view layers take up what handlers have changed before a render. Blender 5 crashes
    where an object was hidden by one and settings were switched off just before."""

    def synchronise(*_arguments) -> None:
        for layer in scene.view_layers:
            _ = layer.objects.active  # Blender brings a layer up to date when it is asked for this.

    bpy.app.handlers.render_pre.append(synchronise)
    try:
        yield
    finally:
        bpy.app.handlers.render_pre.remove(synchronise)


@contextmanager
def _no_render_window() -> Iterator[None]:
    """Keeps Blender from showing a picture that the user did not ask for."""
    preferences = bpy.context.preferences
    before, unsaved = preferences.view.render_display_type, preferences.is_dirty
    preferences.view.render_display_type = "NONE"
    try:
        yield
    finally:
        preferences.view.render_display_type = before
        preferences.is_dirty = unsaved
