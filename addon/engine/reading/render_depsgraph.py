"""A render-mode depsgraph, which Blender gives only to render engines: modifiers at render levels, objects that are
shown in renders only. For one render an engine that passes it on takes the place of the scene's: the add-on's own one
where that is registered, else a hidden one.

In Blender's window the render is a job of Blender's own, on a thread of its own; without a window it is done when the
call returns. Either way the user's settings, picture and windows stay as they were.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, Generic, TypeVar

import bpy

from ...export.camera import why_no_picture
from .engine_name import address_of_engine, set_engine_unseen

Result = TypeVar("Result")
Stop = Callable[[], bool]
"""Returns True if the work should end."""

POLL_SECONDS = 0.01
COPY_SECONDS = 0.01
"""Seconds to wait until a render that begins at once has copied its scene's engine, which takes up to 5 ms."""
SLOT = "Relume"
"""The render slot that takes the empty picture."""
SWITCH_SECONDS = 0.0002
"""Longest time that Blender's window waits for Python while the work runs on another thread. Python's own 5 ms add up
to a standstill, because every panel waits anew."""


class ExportCancelled(Exception):  # noqa: N818 -- what the user wanted is no error
    """The user or Blender stopped it."""


class RelumeExportEngine(bpy.types.RenderEngine):
    """The hidden one; draws nothing."""

    bl_idname = "RELUME_EXPORT"
    bl_label = "Relume (internal)"
    bl_use_preview = False

    def render(self, depsgraph):
        """Called by Blender, once."""
        run_waiting(self, depsgraph)


standing: type[bpy.types.RenderEngine] | None = None
"""The add-on's own engine while it is registered, whose `render` begins with `run_waiting`. To register one for a
reading, or to take it away, would end all that Blender's views draw."""
WITHOUT_EFFECTS = {"use_sequencer": False, "use_compositing": False, "use_freestyle": False}
"""Render settings without what Blender does to a picture once it is rendered. Freestyle would crash where there is
none, and file output nodes would write over the artist's files."""
MARK = "relume_render_settings"
"""Custom property of a scene that is being read, with the render settings that it had before: it is in undo steps and
files that are written meanwhile."""
_reading: dict[int, dict[str, Any]] = {}
"""Scenes that are being read, and the settings that they have until the engine is called."""
_waiting: list[RenderTask[Any]] = []
"""Tasks that the next renders of their scenes are to run."""


def run_waiting(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> bool:
    """Runs the task that waits for a depsgraph of this scene; returns True if there was one. Blender calls for each
    view layer that is rendered, without a window also for those that nobody asked for."""
    found = next((task for task in _waiting if task.scene_uid == depsgraph.scene.session_uid), None)
    if found is not None and depsgraph.view_layer.name == found.layer_name:
        _waiting.remove(found)
        found.run(engine, depsgraph)
    return found is not None or depsgraph.scene.session_uid in _reading


class RenderTask(Generic[Result]):
    """Work with a render-mode depsgraph, and what came of it. Raises RuntimeError of a scene without a picture."""

    def __init__(self, scene: bpy.types.Scene, work: Callable[[bpy.types.Depsgraph, Stop], Result]):
        if words := why_no_picture(scene):  # Blender would not say of which scene.
            raise RuntimeError(words)
        self.scene_name, self.scene_uid, self.layer_name = scene.name, scene.session_uid, render_layer(scene).name
        self.work = work
        self.started = self.cancelled = False
        self._outcome: list[Result] = []
        self._error: BaseException | None = None

    def run(self, engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph) -> None:
        """Called by the engine. No exception leaves it: one would hang Blender before 5.0."""
        self.started = True
        before = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_SECONDS)
        try:
            self._outcome.append(self.work(depsgraph, lambda: self.cancelled or engine.test_break()))
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


def with_render_depsgraph(scene: bpy.types.Scene, work: Callable[[bpy.types.Depsgraph, Stop], Result]) -> Result:
    """Calls `work` with the depsgraph of the scene's present frame and first render layer, and with a function that
    returns True if it should stop. Returns its result. Blender's window stands still meanwhile."""
    task = RenderTask(scene, work)
    with _engine(task) as engine, _surroundings(scene), _render_settings(task, WITHOUT_EFFECTS | {"engine": engine}):
        bpy.ops.render.render(layer=task.layer_name, scene=scene.name)
    return task.result()


def start_with_render_depsgraph(
    scene: bpy.types.Scene,
    work: Callable[[bpy.types.Depsgraph, Stop], Result],
    done: Callable[[Result | None, BaseException | None], None],
) -> RenderTask[Result]:
    """Starts `with_render_depsgraph` and returns at once. `work` runs on another thread; `done` is called from
    Blender's event loop with its result or error."""
    task = RenderTask(scene, work)
    around, settings = ExitStack(), ExitStack()
    try:
        engine = around.enter_context(_engine(task))
        around.enter_context(_surroundings(scene))
        around.push(settings)
        settings.enter_context(_render_settings(task, WITHOUT_EFFECTS))
        with _no_render_window(), bpy.context.temp_override(window=_window()), _unseen_engine(scene, engine):
            _begin_render(scene)
    except BaseException:
        around.close()
        raise

    def poll() -> float | None:
        if task.started:  # Blender needs them no more.
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
    if _is_delayed(scene):
        which["layer"] = render_layer(scene).name
    answer = bpy.ops.render.render("INVOKE_DEFAULT", **which)
    if answer == {"CANCELLED"}:
        raise RuntimeError("Blender is rendering already; wait for its end or press Esc there")


def _is_delayed(scene: bpy.types.Scene) -> bool:
    """True if the render needs the name of its layer: Blender waits 0.2 s then until it begins."""
    return scene.render.use_single_layer or sum(layer.use for layer in scene.view_layers) != 1


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
    """True if a render was asked for: Blender starts its job a moment later."""
    windows = bpy.context.window_manager.windows
    return any(operator.bl_idname == "RENDER_OT_render" for window in windows for operator in window.modal_operators)


def render_layer(scene: bpy.types.Scene) -> bpy.types.ViewLayer:
    """The view layer that a scene is read with: as Blender's own render, the window's where only that is wanted."""
    windows = bpy.context.window_manager.windows if scene.render.use_single_layer else ()
    shown = [window.view_layer for window in windows if window.scene == scene and window.view_layer.use]
    return next(iter([*shown, *(layer for layer in scene.view_layers if layer.use)]), scene.view_layers[0])


def _window() -> bpy.types.Window:
    return bpy.context.window or bpy.context.window_manager.windows[0]


@contextmanager
def _engine(task: RenderTask[Any]) -> Iterator[str]:
    """Context in which the next render of a scene runs a task, if it is by the engine of this name."""
    _waiting.append(task)
    try:
        if standing is not None:
            yield standing.bl_idname
        else:
            with _hidden_engine():
                yield RelumeExportEngine.bl_idname
    finally:
        if task in _waiting:
            _waiting.remove(task)


@contextmanager
def _hidden_engine() -> Iterator[None]:
    # A RenderEngine class left registered crashes Blender 4.2 at exit and hangs 4.5.
    bpy.utils.register_class(RelumeExportEngine)
    try:
        yield
    finally:
        bpy.utils.unregister_class(RelumeExportEngine)


@contextmanager
def _render_settings(task: RenderTask[Any], values: dict[str, Any]) -> Iterator[None]:
    """Gives the scene of a task these settings, and its own ones back."""
    _reading[task.scene_uid] = values.copy()
    settle_settings()
    try:
        yield
    finally:
        _reading.pop(task.scene_uid, None)
        settle_settings()


@contextmanager
def _unseen_engine(scene: bpy.types.Scene, engine: str) -> Iterator[None]:
    """Gives a scene an engine until the render that begins in here has copied it, and nothing of Blender is told. Where
    that cannot be, the engine is one more of the settings that the scene has while it is read."""
    before = scene.render.engine
    address = None if standing is None or _is_delayed(scene) else address_of_engine(scene)
    if address is None:
        _note_engine(scene, before, engine)
        scene.render.engine = engine
        yield
        return
    copied = threading.Event()

    def note(*_arguments) -> None:
        copied.set()

    bpy.app.handlers.render_pre.append(note)  # On the render's thread, right after its copy.
    set_engine_unseen(address, engine)
    try:
        yield
        is_over = copied.wait(COPY_SECONDS)
    except BaseException:
        is_over = True
        raise
    finally:
        bpy.app.handlers.render_pre.remove(note)
        if is_over:
            set_engine_unseen(address, before)
        else:
            _note_engine(scene, before, engine)


def _note_engine(scene: bpy.types.Scene, before: str, engine: str) -> None:
    """Makes the engine one of the settings that the scene has while it is read."""
    scene[MARK]["engine"], _reading[scene.session_uid]["engine"] = before, engine


def settle_settings() -> None:
    """Gives the settings for it to the scenes that are being read and to no others. To be called after a file was
    written, and after undo or a file brought back a moment in which a scene was being read."""
    show_settings()
    for scene in bpy.data.scenes:
        if values := _reading.get(scene.session_uid):
            scene[MARK] = {name: getattr(scene.render, name) for name in values}
            _set_render(scene, values)


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
def _surroundings(scene: bpy.types.Scene) -> Iterator[None]:
    """Lets the user's last picture be, and handlers of other add-ons do what they like."""
    with _kept_render_result(), _synchronised_layers(scene):
        yield


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
