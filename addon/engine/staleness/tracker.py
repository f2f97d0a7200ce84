"""Staleness of a bake: differences of the present scene from the one that was baked, found a little at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import bpy

from ...core.diff import EDITED, Fingerprint, color_text, sentences, world_gain
from . import fingerprints

WHOLE_SCENE = 200
"""An update of more data-blocks than this is taken as one of everything."""

OfView = Callable[[bpy.types.Scene], dict[str, Fingerprint] | None]
"""Fingerprints of a bake's own camera and film, by their keys; None if they are the scene's."""


class StalenessTracker:
    """Compares the fingerprints of a scene with those of its bake, which lie in the bake's folder."""

    def __init__(self, baked: dict[str, Fingerprint] | None, of_view: OfView = lambda _scene: None):
        self._of_view = of_view
        self.is_recording = baked is None
        """True while the fingerprints of the bake itself are being taken."""
        self.baked: dict[str, Fingerprint] = baked or {}
        self.present: dict[str, Fingerprint] = {}
        self.world_color: list[float] | None = None
        """Colour of the world that is shown, if the bake says so. It may have been begun before the recording."""
        self.world_map: str | None = None
        """Native module's name of the world map that is shown, once there are paths."""
        self.maps: dict[str, str] = {}
        """Shape in the fingerprint of each world, by the native module's name of its map."""
        self._refused: dict[str, str] = {}
        """Why worlds could not be shown, by the shape in their fingerprint."""
        self.sentences: list[str] = []
        """Differences in words, for the artist."""
        self._different: dict[str, None] = {}
        self._waiting: dict[str, None] = {}
        """Keys of edited data-blocks, whose fingerprints are to be taken again."""
        self._scan: Iterator[tuple[str, fingerprints.Fingerprinter]] | None = None
        self._current: tuple[str, fingerprints.Steps] | None = None
        """Fingerprint that is being taken."""
        self._scanned: set[str] = set()
        self._needs_scan = self._scans_all = True
        self._is_scan_outdated = False
        """True if something came or went during the scan."""

    @property
    def is_pending(self) -> bool:
        """True if fingerprints have still to be taken."""
        return bool(self._waiting) or self._needs_scan or self._current is not None

    def mark(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> bool:
        """Marks updated data-blocks, whose fingerprints are to be taken again. The world's is taken at once; returns
        True if the world changed."""
        if self.is_recording:
            self._mark_edited(scene, updates)
        if len(updates) > WHOLE_SCENE:
            self.mark_all()
            return self._update_world(scene)
        edited = [update.id.original for update in updates]
        keys = fingerprints.keys_of_blocks(edited, scene)
        self._waiting |= keys
        self._waiting["rules"] = None  # Blender does not name a light whose settings of Cycles change.
        if any(isinstance(block, (bpy.types.Scene, bpy.types.Collection)) for block in edited):
            self._is_scan_outdated = self._scan is not None
            self._needs_scan = True
        return "world" in keys and self._update_world(scene)

    def _mark_edited(self, scene: bpy.types.Scene, updates: list[bpy.types.DepsgraphUpdate]) -> None:
        """Marks as edited what was moved, reshaped or shaded anew before its fingerprint was taken.

        Blender also names what was only evaluated again. For shading that is what uses an edited material. For geometry
        it is what reads collections that were put in order, as Start does, and from 5.3 on what uses an edited
        material. Where a scene is removed, as after reading, it is all metaballs."""
        around = (bpy.types.Collection, bpy.types.Material)
        names_objects = any(isinstance(update.id, around) for update in updates)
        for update in updates:
            is_object = isinstance(update.id, bpy.types.Object)
            is_meta = update.id.type == "META" if is_object else isinstance(update.id, bpy.types.MetaBall)
            if names_objects and is_meta:
                continue
            reshaped = update.is_updated_geometry and not (names_objects and is_object)
            kinds: tuple[str, ...] = ("material ",) * (update.is_updated_shading and not is_object)
            if update.is_updated_transform or reshaped:
                kinds += ("object ", "helper ", "data ")
            for key in fingerprints.keys_of_block(update.id.original, scene) if kinds else ():
                if key.startswith(kinds):
                    self.baked.setdefault(key, EDITED)

    def rename_camera(self, name: str) -> None:
        """Notes the new name of the bake's camera."""
        if "camera" in self.baked:
            self.baked["camera"] = self.baked["camera"] | {"name": name}
        self._waiting["camera"] = None

    def mark_all(self) -> None:
        """Marks the whole scene, for example after undo."""
        self._scan, self._current, self._is_scan_outdated = None, None, False
        self._needs_scan = self._scans_all = True

    def mark_files(self) -> bool:
        """Marks files of images and volumes, which other programs may have written. Returns True if there are any."""
        files = {key: None for key in self.present if key.startswith(("image ", "volume "))}
        if files:
            files["sequences"] = None
        self._waiting |= files
        return bool(files)

    def mark_frame(self) -> None:
        """Marks sequences and smoke, which Blender does not name when another frame is shown."""
        volumes = [key for key in self.present if key.startswith("volume ")]
        self._waiting |= dict.fromkeys(["sequences", "smoke", *volumes])

    def reload_images(self) -> None:
        """Makes Blender read the image files again that changed since the bake, as a render by Cycles does. Images with
        unsaved paint stay."""
        for image in bpy.data.images:
            if f"image {image.name_full}" in self._different and not image.is_dirty:
                image.reload()

    def _update_world(self, scene: bpy.types.Scene) -> bool:
        before = self.present.get("world")
        self._keep("world", fingerprints.world(scene))
        return before is not None and before != self.present["world"]

    def note_world(self, world_map: str | None, color: list[float] | None) -> None:
        """Notes the world that is shown."""
        if (self.world_map, self.world_color) != (world_map, color):
            self.world_map, self.world_color = world_map, color
            self.sentences = self._sentences()

    def new_world_shape(self) -> str | None:
        """Shape of the present world's fingerprint, if it differs from the shown world by more than strength and tint
        and was not refused; else None."""
        present = self.present.get("world")
        if self.world_map is None or present is None or present["shape"] in self._refused:
            return None
        return present["shape"] if world_gain(self.baked_fingerprints().get("world"), present) is None else None

    def refuse_world(self, shape: str, why: str) -> None:
        """Notes why a world could not be shown."""
        self._refused[shape] = why
        self.sentences = self._sentences()

    def _sentences(self) -> list[str]:
        """Differences in words. The world is followed without new paths, so it is one only where that failed."""
        if self.world_map is None:
            return sentences(self._different, self.baked, self.present)
        why = self._refused.get(self.present.get("world", {}).get("shape", ""))
        others = [key for key in self._different if key != "world"]
        refusal = [] if why is None else [f"The world changed, and its light could not be gathered: {why}"]
        return [*refusal, *sentences(others, self.baked, self.present)]

    def world_gain(self) -> list[float]:
        """Factor on the light of the world that is shown, where only its strength or tint changed."""
        return world_gain(self.baked_fingerprints().get("world"), self.present.get("world")) or [1.0, 1.0, 1.0]

    def baked_fingerprints(self) -> dict[str, Fingerprint]:
        """Fingerprints of the bake, under the world that is shown."""
        if self.world_color is None or "world" not in self.baked:
            return self.baked
        world = self.baked["world"] | {"color": color_text(self.world_color)}
        if self.world_map is not None:
            world["shape"] = self.maps.get(self.world_map, "")
        return self.baked | {"world": world}

    def update(self, scene: bpy.types.Scene, seconds: float) -> bool:
        """Takes fingerprints for about that many seconds. Returns True if the sentences changed."""
        if not self.is_pending:
            return False
        deadline = time.perf_counter() + seconds
        try:
            if not self._continue_current(deadline):
                return False
            if not self.is_recording:  # Until then what was edited may not be what was baked.
                self._take_waiting(scene, deadline)
            if self._current is not None or not self._continue_scan(scene, deadline):
                return False
        except ReferenceError:  # Something was deleted in the middle of the scan.
            self._scan = self._current = None
            return False
        before, self.sentences = self.sentences, self._sentences()
        return self.sentences != before

    def _continue_current(self, deadline: float) -> bool:
        """Continues the fingerprint that is being taken, if there is one. Returns True if there is time for another."""
        if self._current is None:
            return True
        key, steps = self._current
        try:
            while True:
                next(steps)
                if time.perf_counter() > deadline:
                    return False
        except StopIteration as end:
            self._current = None
            self._keep(key, end.value)
        return time.perf_counter() <= deadline

    def _take_waiting(self, scene: bpy.types.Scene, deadline: float) -> None:
        """Takes the fingerprints of edited data-blocks."""
        while self._waiting:
            key, _ = self._waiting.popitem()
            self._current = key, self._taking(scene, key, partial(fingerprints.fingerprint, scene, key))
            if not self._continue_current(deadline):
                return

    def _continue_scan(self, scene: bpy.types.Scene, deadline: float) -> bool:
        """Continues the scan of the scene: takes new fingerprints, or all, and forgets those of what is gone. Returns
        True if the scan is done. Edits meanwhile do not restart it, or it might never end."""
        if not self._needs_scan:
            return True
        if self._scan is None:
            self._scan, self._scanned = fingerprints.iter_fingerprints(scene), set()
        for key, take in self._scan:
            if key:
                self._scanned.add(key)
                if self._scans_all or key not in self.present:
                    self._current = key, self._taking(scene, key, take)
            if not self._continue_current(deadline) or time.perf_counter() > deadline:
                return False
        for key in {**self.baked, **self.present}.keys() - self._scanned:
            if self.is_recording and not key.startswith("object "):  # Edited meanwhile, but no part of the scene.
                self.baked.pop(key, None)
            self._keep(key, None)
        self._scan = None
        self._needs_scan, self._is_scan_outdated = self._is_scan_outdated, False
        self._scans_all = self.is_recording = False
        return True

    def _taking(self, scene: bpy.types.Scene, key: str, take: fingerprints.Fingerprinter) -> fingerprints.Steps:
        """Steps of a fingerprint: of camera and film those of the bake's own."""
        own = self._of_view(scene) if key in {"camera", "film"} else None
        if own is None:
            return take()
        return fingerprints.in_one_step(own.get, key)

    def _keep(self, key: str, taken: Fingerprint | None) -> None:
        """Keeps the fingerprint of a key, or forgets it if there is none."""
        if taken is None:
            self.present.pop(key, None)
        else:
            self.present[key] = taken
            if self.is_recording:
                self.baked.setdefault(key, taken)
        if self.baked.get(key) == taken:
            self._different.pop(key, None)
        else:
            self._different[key] = None
