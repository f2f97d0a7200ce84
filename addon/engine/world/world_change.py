"""Reading of a world that is to replace the one that is shown: another HDRI, or one that was turned. The artist's data
are read at once; the rest is done on a thread. Its light is then gathered from the paths that are there."""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any

import bpy

from ...export.images import ImageExporter, TextureSize, texture_size
from ...export.node_graph import NodeGraph, WorldRenderError
from ...export.stop import ExportCancelled
from ...export.view_layer import render_layer
from ...export.working_space import working_space
from ...export.world import export_world
from ..native import native
from . import worlds


class _UnreadableFileError(Exception):
    """The native module cannot read an image file: Blender has to."""


class WorldTask:
    """The present world of a scene in the making."""

    def __init__(self, scene: bpy.types.Scene, shape: str, before: WorldTask | None = None, by_blender: bool = False):
        """`before`: the world that is shown, whose file is not read again where this one has the same."""
        self.shape = shape
        """Shape of its fingerprint."""
        self.world: Any = None
        """A `relume.World`, once it is done."""
        self.error: Exception | None = None
        self._stopped = False
        known = before.source if before else None
        steps = self._steps(scene, by_blender, known)
        if steps.has_parts and steps.is_same:
            steps = self._steps(scene, by_blender, None)
        self.source: Hashable = None if steps.has_parts else steps.source
        """Source of its texture; None if nothing tells whether another one is the same."""
        self._texture_of = before.world if before and steps.is_same else None
        self._builder = native().SceneBuilder(working_space())
        self._thread = threading.Thread(target=self._run, args=(steps.calls,), daemon=True)
        self._thread.start()

    def _steps(self, scene: bpy.types.Scene, by_blender: bool, known: Hashable) -> _Steps:
        steps = _Steps(by_blender, known, texture_size(scene), lambda: self._stopped)
        images = ImageExporter(steps, scene.frame_current, size=steps.size)
        export_world(steps, images, steps.texture_of, scene, render_layer(scene))
        return steps

    def _run(self, calls: list[Callable[[Any], None]]) -> None:
        try:
            for call in calls:
                call(self._builder)
            self.world = self._builder.build_world(texture_of=self._texture_of)
        except Exception as error:
            self.error = error

    @property
    def done(self) -> bool:
        """True if there is a world, or an error."""
        return not self._thread.is_alive()

    @property
    def was_cancelled(self) -> bool:
        """True if it was cancelled before it was done."""
        return isinstance(self.error, ExportCancelled)

    @property
    def needs_blender(self) -> bool:
        """True if it has to be tried again with pixels that Blender reads."""
        return isinstance(self.error, _UnreadableFileError)

    def cancel(self) -> None:
        """Lets it end soon, if Cycles renders it."""
        self._stopped = True


class _Steps:
    """Stands in for a scene builder: keeps what is to be done, which takes its time."""

    def __init__(self, by_blender: bool, known: Hashable, size: TextureSize, stop: Callable[[], bool]):
        self.calls: list[Callable[[Any], None]] = []
        self.source: Hashable = None
        self.is_same = False
        """True if the texture is that of `known`, and need not be read."""
        self.has_parts = False
        """True if rays of some kinds see another light: each part has a texture of its own."""
        self.size = size
        self._by_blender, self._known, self._stop = by_blender, known, stop
        self._textures = 0

    def add_texture(self, *arguments: Any, **more: Any) -> int:
        """Adds a texture; called like the scene builder's method."""
        return self._texture(lambda builder: builder.add_texture(*arguments, **more))

    def add_texture_file(self, name: str, *arguments: Any, **more: Any) -> int | None:
        """Adds a texture's file; called like the scene builder's method. A file that cannot be read is noticed
        later."""

        def add(builder: Any) -> None:
            if builder.add_texture_file(name, *arguments, **more) is None:
                raise _UnreadableFileError(name)

        if self._by_blender:
            return None
        self.source = _source(*arguments, **more)
        self.is_same = self.source is not None and self.source == self._known
        return 0 if self.is_same else self._texture(add)

    def texture_of(self, graph: NodeGraph, name: str) -> int:
        """Renders the world by Cycles."""
        render = worlds.rendering(graph, self.size)
        return self._texture(
            lambda builder: builder.add_texture(name, render(self._stop), encoding="linear", alpha="none")
        )

    def set_world(self, *arguments: Any, **more: Any) -> None:
        """Sets the world; called like the scene builder's method."""
        self.has_parts = "parts" in more
        if self.is_same:
            more["texture"] = None
        self.calls.append(lambda builder: builder.set_world(*arguments, **more))

    def constant_emission(self, shader: str) -> Any:
        """Computes what a shader emits everywhere, as the scene builder does."""
        return native().SceneBuilder.constant_emission(shader)

    def warn(self, message: str) -> None:
        """Adds a warning; called like the scene builder's method."""
        self.calls.append(lambda builder: builder.warn(message))

    def _texture(self, add: Callable[[Any], Any]) -> int:
        self.calls.append(add)
        self._textures += 1
        return self._textures - 1


def _source(file: str | bytes, **settings: Hashable) -> Hashable:
    """Key of all that the pixels of an image file depend on; None if there is no such file."""
    if isinstance(file, bytes):
        return file, *settings.items()
    try:
        found = Path(file).stat()
    except OSError:
        return None
    return file, found.st_size, found.st_mtime_ns, *settings.items()


def reason(error: Exception) -> str:
    """Why a world could not be read, in one line."""
    words = " ".join(str(error).split()) or repr(error)
    return f"Cycles could not render it: {words}" if isinstance(error, WorldRenderError) else words
