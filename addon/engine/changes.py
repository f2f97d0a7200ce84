"""Notices what has become of a scene since it was baked. The bake's prints lie in its folder; those of the present
scene are taken a little at a time."""

from __future__ import annotations

import time

import bpy

from ..core.differences import EDITED, Print, sentences, world_gain
from . import prints

WHOLE_SCENE = 200
"""An update of more data-blocks than this is taken as one of everything."""


class Changes:
    """Compares a scene with its bake."""

    def __init__(self, baked: dict[str, Print] | None):
        self.recording = baked is None
        """Whether the prints of the bake are being taken."""
        self.baked: dict[str, Print] = baked or {}
        self.present: dict[str, Print] = {}
        self.sentences: list[str] = []
        """What has changed, for the artist."""
        self._waiting: dict[str, None] = {}
        self._prints: prints.Prints | None = None
        self._listed = False

    @property
    def is_pending(self) -> bool:
        """Whether something has still to be looked at."""
        return bool(self._waiting) or not self._listed

    def mark(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> bool:
        """Data-blocks were updated and are to be looked at again. The world is at once: whether it is another one."""
        self._prints = None
        edited = [update.id.original for update in updates]
        if self.recording:
            self._mark_edited(scene, updates)
        if len(edited) > WHOLE_SCENE:
            self.mark_all()
            return self._look_at_world(scene)
        found = {key: None for block in edited for key in prints.keys_of(block, scene)}
        self._waiting |= found
        if any(isinstance(block, (bpy.types.Scene, bpy.types.Collection)) for block in edited):
            self._listed = False
        return "world" in found and self._look_at_world(scene)

    def _mark_edited(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> None:
        """What was moved or reshaped before its print was taken is not what was baked. Blender also names what was only
        evaluated again."""
        for update in updates:
            if update.is_updated_transform or update.is_updated_geometry:
                for key in prints.keys_of(update.id.original, scene):
                    if key.startswith(("object ", "data ")):
                        self.baked.setdefault(key, EDITED)

    def mark_all(self) -> None:
        """Anything may have been edited, such as by undo."""
        self._prints, self._listed = None, False
        self._waiting |= dict.fromkeys(self.present)

    def _look_at_world(self, scene: bpy.types.Scene) -> bool:
        before = self.present.get("world")
        self.present["world"] = prints.world(scene)
        return before is not None and before != self.present["world"]

    def world_gain(self) -> list[float]:
        """Factor on the baked light of the world, where it only became brighter, darker or of another colour."""
        return world_gain(self.baked.get("world"), self.present.get("world")) or [1.0, 1.0, 1.0]

    def look(self, scene: bpy.types.Scene, seconds: float) -> bool:
        """Takes prints for about so long. Whether the sentences are other ones now."""
        if not self.is_pending:
            return False
        try:
            self._look(scene, time.perf_counter() + seconds)
        except ReferenceError:  # Something was deleted and nobody was told.
            self.mark_all()
        if self.is_pending:
            return False
        self.recording = False
        before, self.sentences = self.sentences, sentences(self.baked, self.present)
        return self.sentences != before

    def _look(self, scene: bpy.types.Scene, deadline: float) -> None:
        self._prints = self._prints or prints.Prints(scene)
        if not self._listed:
            keys = dict.fromkeys(prints.keys(scene))
            self.present = {key: found for key, found in self.present.items() if key in keys}
            self._waiting = {key: None for key in self._waiting if key in keys}
            self._waiting |= {key: None for key in keys if key not in self.present}
            self._listed = True
        while self._waiting and time.perf_counter() < deadline:
            key, _ = self._waiting.popitem()
            found = self._prints.of(key)
            if found is None:
                self.present.pop(key, None)
                continue
            self.present[key] = found
            if self.recording:
                self.baked.setdefault(key, found)
