"""A render-mode depsgraph, which Blender gives only to render engines: modifiers at render levels, objects that are
shown in renders only. For one render the engine of the scene is borrowed where it can be, or a hidden one is
registered, and passes its depsgraph on.

In Blender's window the render is a job of Blender's own, on a thread of its own; without a window it is done when the
call returns. Either way the user's settings, picture and windows stay as they were.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Generic, TypeVar

import bpy

from ..export.camera import why_no_picture

Result = TypeVar("Result")
Stop = Callable[[], bool]
"""Whether the work should end."""

POLL_SECONDS = 0.01
SLOT = "Relume"
"""The render slot that takes the empty picture."""
LENT = {"CYCLES", "RELUME"}
"""Engines in Python, whose class runs the task in place of a render. For another one in the scene Blender would end the
views that the scene's draws, and begin them anew (docs/overlay.md)."""
SWITCH_SECONDS = 0.0002
"""How long Blender's window waits for Python while the work runs on another thread; Python's own 5 ms add up to a
standstill, because every panel waits anew."""


class ExportCancelled(Exception):  # noqa: N818 -- what the user wanted is no error
    """The user or Blender stopped it."""


class RelumeExportEngine(bpy.types.RenderEngine):
    """Hands the depsgraph of a final render to `task` and draws nothing."""

    bl_idname = "RELUME_EXPORT"
    bl_label = "Relume (internal)"
    bl_use_preview = False

    task: RenderTask[Any] | None = None

    def render(self, depsgraph):
        """Called by Blender, once."""
        task, type(self).task = type(self).task, None
        if task is not None:
            task.run(self, depsgraph)


PLAIN = {"use_sequencer": False, "use_compositing": False}
"""Render settings of a scene that is being read, until Blender has copied them."""
HIDDEN = PLAIN | {"engine": RelumeExportEngine.bl_idname}
"""The same where its engine is not borrowed."""
MARK = "relume_render_settings"
"""Custom property of such a scene, with what they were: it is in undo steps and files that are written meanwhile."""
_reading: dict[int, dict[str, Any]] = {}
"""Such scenes, and their settings."""


class RenderTask(Generic[Result]):
    """Work with a render-mode depsgraph, and what came of it. Raises RuntimeError of a scene without a picture."""

    def __init__(self, scene: bpy.types.Scene, work: Callable[[bpy.types.Depsgraph, Stop], Result]):
        if words := why_no_picture(scene):  # Blender would not say of which scene.
            raise RuntimeError(words)
        self.scene_name, self.scene_uid = scene.name, scene.session_uid
        self.work = work
        self.started = self.cancelled = False
        self._outcome: list[Result] = []
        self._error: BaseException | None = None

    def run(self, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
        """Called by the engine. No exception leaves it: one would hang Blender before 5.0."""
        self.started = True
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_SECONDS)
        # Nothing may keep the engine, which Blender frees: neither what `work` leaves nor the frames of an error.
        engines = [engine]
        try:
            self._outcome.append(self.work(depsgraph, lambda: self.cancelled or not engines or engines[0].test_break()))
        except BaseException as error:
            self._error = _without_frames(error)
        finally:
            engines.clear()
            sys.setswitchinterval(before)

    def cancel(self) -> None:
        """Asks the work to end."""
        self.cancelled = True

    def result(self) -> Result:
        """What the work returned; raises what it raised."""
        if self._error is not None:
            raise self._error
        if self._outcome:
            return self._outcome[0]
        if self.cancelled:
            raise ExportCancelled("cancelled")
        raise RuntimeError(
            f"Blender did not render scene '{self.scene_name}'; is a camera set, is a view layer enabled?"
        )


def _without_frames(error: BaseException) -> BaseException:
    """An error, and those that led to it, without what keeps the frames of their calls."""
    link: BaseException | None = error
    while link is not None:
        link.__traceback__ = None
        link = link.__cause__ or link.__context__
    return error


def with_render_depsgraph(scene: bpy.types.Scene, work: Callable[[bpy.types.Depsgraph, Stop], Result]) -> Result:
    """The result of `work`, called with the depsgraph of the scene's present frame and first render layer, and with
    what says whether to stop. Blender's window stands still meanwhile."""
    task = RenderTask(scene, work)
    with _engine(task, scene) as settings, _kept_render_result(), _render_settings(task, settings):
        bpy.ops.render.render(layer=render_layer(scene).name, scene=scene.name)
    return task.result()


def start_with_render_depsgraph(
    scene: bpy.types.Scene,
    work: Callable[[bpy.types.Depsgraph, Stop], Result],
    done: Callable[[Result | None, BaseException | None], None],
) -> RenderTask[Result]:
    """As `with_render_depsgraph`, but returns at once: `work` runs on another thread, `done` is called from Blender's
    event loop with its result or error."""
    task = RenderTask(scene, work)
    around, settings = ExitStack(), ExitStack()
    try:
        wanted = around.enter_context(_engine(task, scene))
        around.enter_context(_kept_render_result())
        around.push(settings)
        settings.enter_context(_render_settings(task, wanted))
        with _no_render_window(), bpy.context.temp_override(window=_window()):
            _begin_render(scene)
    except BaseException:
        around.close()
        raise

    def poll() -> float | None:
        if task.started:  # Blender has copied them.
            settings.close()
        if bpy.app.is_job_running("RENDER") or (not task.started and _is_waiting()):
            return POLL_SECONDS
        around.close()
        _finish(task, done)
        return None

    bpy.app.timers.register(poll, first_interval=POLL_SECONDS, persistent=True)
    return task


def _begin_render(scene: bpy.types.Scene) -> None:
    """Starts Blender's job. Blender makes a graphics context for its first one of a scene, whatever the engine."""
    which = {"scene": scene.name}
    if scene.render.use_single_layer or sum(layer.use for layer in scene.view_layers) != 1:
        which["layer"] = render_layer(scene).name  # Blender waits 0.2 s where one is named.
    answer = bpy.ops.render.render("INVOKE_DEFAULT", **which)
    if answer == {"CANCELLED"}:
        raise RuntimeError("Blender is rendering already; wait for its end or press Esc there")


def _finish(task: RenderTask[Result], done: Callable[[Result | None, BaseException | None], None]) -> None:
    if not task.started:  # Stopped before it began.
        task.cancel()
    try:
        result = task.result()
    except BaseException as error:
        done(None, error)
    else:
        done(result, None)


def _is_waiting() -> bool:
    """Whether a render was asked for: Blender starts its job a moment later."""
    windows = bpy.context.window_manager.windows
    return any(operator.bl_idname == "RENDER_OT_render" for window in windows for operator in window.modal_operators)


def render_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that a scene is read with."""
    return next((layer for layer in scene.view_layers if layer.use), scene.view_layers[0])


def _window() -> bpy.types.Window:
    return bpy.context.window or bpy.context.window_manager.windows[0]


@contextmanager
def _engine(task: RenderTask[Any], scene: bpy.types.Scene) -> Iterator[dict[str, Any]]:
    """Has the next render of a scene run a task; the settings that the scene needs for that."""
    name = scene.render.engine
    engines = bpy.types.RenderEngine.__subclasses__() if name in LENT else []
    lent = next((cls for cls in engines if getattr(cls, "bl_idname", "") == name and cls.is_registered), None)
    with _hidden_engine(task) if lent is None else _borrowed(lent, task):
        yield HIDDEN if lent is None else PLAIN


@contextmanager
def _borrowed(lent: type[bpy.types.RenderEngine], task: RenderTask[Any]) -> Iterator[None]:
    """Blender asks a class for its functions at each call. It may render previews with it at the same time."""
    before = {name: vars(lent)[name] for name in ("update", "render") if name in vars(lent)}

    def is_ours(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> bool:
        return not engine.is_preview and depsgraph.scene.session_uid == task.scene_uid

    def update(self, data, depsgraph):
        if not is_ours(self, depsgraph):
            before["update"](self, data, depsgraph)

    def render(self, depsgraph):
        if not is_ours(self, depsgraph):
            before["render"](self, depsgraph)
        elif not task.started:
            task.run(self, depsgraph)

    for name in before:
        setattr(lent, name, {"update": update, "render": render}[name])
    try:
        yield
    finally:
        for name, function in before.items():
            setattr(lent, name, function)


@contextmanager
def _hidden_engine(task: RenderTask[Any]) -> Iterator[None]:
    # A RenderEngine class left registered crashes Blender 4.2 at exit and hangs 4.5.
    bpy.utils.register_class(RelumeExportEngine)
    RelumeExportEngine.task = task
    try:
        yield
    finally:
        RelumeExportEngine.task = None
        bpy.utils.unregister_class(RelumeExportEngine)


@contextmanager
def _render_settings(task: RenderTask[Any], settings: dict[str, Any]) -> Iterator[None]:
    """Gives the scene these settings, and its own ones back."""
    _reading[task.scene_uid] = settings
    settle_settings()
    try:
        yield
    finally:
        _reading.pop(task.scene_uid, None)
        settle_settings()


def settle_settings() -> None:
    """Gives the settings for it to the scenes that are being read and to no others. To be called after a file was
    written, and after undo or a file brought back a moment in which a scene was being read."""
    show_settings()
    for scene in bpy.data.scenes:
        if settings := _reading.get(scene.session_uid):
            scene[MARK] = {name: getattr(scene.render, name) for name in settings}
            _set_render(scene, settings)


def show_settings() -> None:
    """Gives every scene the artist's render settings back. To be called before a file is written."""
    for scene in bpy.data.scenes:
        if MARK in scene:
            before = scene[MARK].to_dict()
            del scene[MARK]
            _set_render(scene, before)


def _set_render(scene: bpy.types.Scene, values: dict[str, Any]) -> None:
    for name, value in values.items():
        with suppress(TypeError):  # The engine of an add-on that is not enabled any more.
            setattr(scene.render, name, value)


@contextmanager
def _kept_render_result() -> Iterator[None]:
    """Lets the user's last picture be: the empty one goes into a slot of its own."""
    image = _render_result()
    if image is None:  # Blender makes it. If it went again, Blender would put all that its views draw together anew.
        yield
        return
    slots = image.render_slots
    before = slots.active_index
    names = [slot.name for slot in slots]
    if SLOT not in names:
        slots.new(name=SLOT)
    slots.active_index = names.index(SLOT) if SLOT in names else len(names)
    try:
        yield
    finally:
        image = _render_result()
        if image is not None:
            image.render_slots.active_index = before


def _render_result() -> bpy.types.Image | None:
    return next((image for image in bpy.data.images if image.type == "RENDER_RESULT"), None)


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
