"""Notices what has become of a scene since it was baked. The bake's prints lie in its folder; those of the present
scene are taken a little at a time."""

from __future__ import annotations

import time
from collections.abc import Iterator

import bpy

from ..core.diff import EDITED, Print, color_text, sentences, world_gain
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
        self.world_color: list[float] | None = None
        """Of the world that is shown, where the bake says so: it may have been begun before the recording."""
        self.world_map: str | None = None
        """Which world is shown, in the native module's words, once there are paths."""
        self.maps: dict[str, str] = {}
        """Shapes of prints of worlds by what the native module calls them."""
        self._refused: dict[str, str] = {}
        """Shapes of worlds that could not be shown: why."""
        self.sentences: list[str] = []
        """What has changed, for the artist."""
        self._different: dict[str, None] = {}
        self._waiting: dict[str, None] = {}
        self._walk: Iterator[tuple[str, prints.Take]] | None = None
        self._taking: tuple[str, prints.Steps] | None = None
        """The print that is being taken."""
        self._walked: set[str] = set()
        self._wants_walk = self._takes_all = True
        self._is_outdated = False
        """Whether something came or went during the walk."""

    @property
    def is_pending(self) -> bool:
        """Whether something has still to be looked at."""
        return bool(self._waiting) or self._wants_walk or self._taking is not None

    def mark(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> bool:
        """Data-blocks were updated and are to be looked at again. The world is at once: whether it is another one."""
        if self.recording:
            self._mark_edited(scene, updates)
        if len(updates) > WHOLE_SCENE:
            self.mark_all()
            return self._look_at_world(scene)
        edited = [update.id.original for update in updates]
        found = prints.keys_of(edited, scene)
        self._waiting |= found
        if any(isinstance(block, (bpy.types.Scene, bpy.types.Collection)) for block in edited):
            self._is_outdated = self._walk is not None
            self._wants_walk = True
        return "world" in found and self._look_at_world(scene)

    def _mark_edited(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> None:
        """What was moved, reshaped or given another look before its print was taken is not what was baked. Blender also
        names what was only evaluated again: for its shading what uses an edited material, and for its geometry what
        reads collections that were put in order, which Start does, and from 5.3 on what uses an edited material."""
        around = (bpy.types.Collection, bpy.types.Material)
        names_objects = any(isinstance(update.id, around) for update in updates)
        for update in updates:
            is_object = isinstance(update.id, bpy.types.Object)
            reshaped = update.is_updated_geometry and not (names_objects and is_object)
            kinds: tuple[str, ...] = ("material ",) * (update.is_updated_shading and not is_object)
            if update.is_updated_transform or reshaped:
                kinds += ("object ", "helper ", "data ")
            for key in prints.own_keys_of(update.id.original, scene) if kinds else ():
                if key.startswith(kinds):
                    self.baked.setdefault(key, EDITED)

    def rename_camera(self, name: str) -> None:
        """The camera of the bake is called otherwise now."""
        if "camera" in self.baked:
            self.baked["camera"] = self.baked["camera"] | {"name": name}
        self._waiting["camera"] = None

    def mark_all(self) -> None:
        """Anything may have been edited, such as by undo."""
        self._walk, self._taking, self._is_outdated = None, None, False
        self._wants_walk = self._takes_all = True

    def mark_files(self) -> bool:
        """Image files may have been written by other programs, of which nobody tells. Whether there are any."""
        files = {key: None for key in self.present if key.startswith("image ")}
        if files:
            files["sequences"] = None
        self._waiting |= files
        return bool(files)

    def mark_frame(self) -> None:
        """Another frame is shown: so may image sequences do, which Blender does not name."""
        self._waiting["sequences"] = None

    def reload_images(self) -> None:
        """Has Blender read the files anew that changed since the bake, as a render by Cycles does; what was painted
        and not saved stays."""
        for image in bpy.data.images:
            if f"image {image.name_full}" in self._different and not image.is_dirty:
                image.reload()

    def _look_at_world(self, scene: bpy.types.Scene) -> bool:
        before = self.present.get("world")
        self._keep("world", prints.world(scene))
        return before is not None and before != self.present["world"]

    def note_world(self, world_map: str | None, color: list[float] | None) -> None:
        """Says which world is shown."""
        if (self.world_map, self.world_color) != (world_map, color):
            self.world_map, self.world_color = world_map, color
            self.sentences = self._sentences()

    def other_world(self) -> str | None:
        """Shape of the present world, where that differs from the one that is shown by more than strength and tint, and
        may be shown in its place."""
        present = self.present.get("world")
        if self.world_map is None or present is None or present["shape"] in self._refused:
            return None
        return present["shape"] if world_gain(self.of_bake().get("world"), present) is None else None

    def refuse_world(self, shape: str, why: str) -> None:
        """A world could not be shown."""
        self._refused[shape] = why
        self.sentences = self._sentences()

    def _sentences(self) -> list[str]:
        """The world is followed without new paths: it is no change but where that went wrong."""
        if self.world_map is None:
            return sentences(self._different, self.baked, self.present)
        why = self._refused.get(self.present.get("world", {}).get("shape", ""))
        others = [key for key in self._different if key != "world"]
        refusal = [] if why is None else [f"The world changed, and its light could not be gathered: {why}"]
        return [*refusal, *sentences(others, self.baked, self.present)]

    def world_gain(self) -> list[float]:
        """Factor on the light of the world that is shown, where it only became brighter, darker or of another tint."""
        return world_gain(self.of_bake().get("world"), self.present.get("world")) or [1.0, 1.0, 1.0]

    def of_bake(self) -> dict[str, Print]:
        """The prints of the bake, under the world that is shown."""
        if self.world_color is None or "world" not in self.baked:
            return self.baked
        world = self.baked["world"] | {"color": color_text(self.world_color)}
        if self.world_map is not None:
            world["shape"] = self.maps.get(self.world_map, "")
        return self.baked | {"world": world}

    def look(self, scene: bpy.types.Scene, seconds: float) -> bool:
        """Takes prints for about so long. Whether the sentences are other ones now."""
        if not self.is_pending:
            return False
        deadline = time.perf_counter() + seconds
        try:
            if not self._go_on_taking(deadline):
                return False
            if not self.recording:  # Until then what was edited may not be what was baked.
                self._take_waiting(scene, deadline)
            if self._taking is not None or not self._go_on_walking(scene, deadline):
                return False
        except ReferenceError:  # Something was deleted in the middle of the walk.
            self._walk = self._taking = None
            return False
        before, self.sentences = self.sentences, self._sentences()
        return self.sentences != before

    def _go_on_taking(self, deadline: float) -> bool:
        """Goes on with the print that is being taken, if there is one. Whether there is time for another."""
        if self._taking is None:
            return True
        key, steps = self._taking
        try:
            while True:
                next(steps)
                if time.perf_counter() > deadline:
                    return False
        except StopIteration as end:
            self._taking = None
            self._keep(key, end.value)
        return time.perf_counter() <= deadline

    def _take_waiting(self, scene: bpy.types.Scene, deadline: float) -> None:
        """Takes the prints of what was edited."""
        while self._waiting:
            key, _ = self._waiting.popitem()
            self._taking = key, prints.take(scene, key)
            if not self._go_on_taking(deadline):
                return

    def _go_on_walking(self, scene: bpy.types.Scene, deadline: float) -> bool:
        """Walks over the scene: takes what is new, or everything, and forgets what is gone. Whether that is done.
        Edits meanwhile do not begin it again, or it might never end."""
        if not self._wants_walk:
            return True
        if self._walk is None:
            self._walk, self._walked = prints.walk(scene), set()
        for key, take in self._walk:
            if key:
                self._walked.add(key)
                if self._takes_all or key not in self.present:
                    self._taking = key, take()
            if not self._go_on_taking(deadline) or time.perf_counter() > deadline:
                return False
        for key in {**self.baked, **self.present}.keys() - self._walked:
            if self.recording and not key.startswith("object "):  # Edited meanwhile, but no part of the scene.
                self.baked.pop(key, None)
            self._keep(key, None)
        self._walk = None
        self._wants_walk, self._is_outdated = self._is_outdated, False
        self._takes_all = self.recording = False
        return True

    def _keep(self, key: str, found: Print | None) -> None:
        """Notes a print, or that there is none."""
        if found is None:
            self.present.pop(key, None)
        else:
            self.present[key] = found
            if self.recording:
                self.baked.setdefault(key, found)
        if self.baked.get(key) == found:
            self._different.pop(key, None)
        else:
            self._different[key] = None
