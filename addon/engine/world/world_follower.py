"""Follows the world of a scene whose shot shows another one."""

from __future__ import annotations

import bpy

from ..staleness.tracker import StalenessTracker
from . import world_change
from .world_change import WorldTask


class WorldFollower:
    """Present world of one shot, made ready to be shown. A world that was refused is skipped; one under way is given up
    for a newer one."""

    def __init__(self, changes: StalenessTracker):
        self._changes = changes
        self._task: WorldTask | None = None
        """World that is being read, to replace the one that is shown."""
        self._before: WorldTask | None = None
        """The world that was read last."""

    @property
    def is_reading(self) -> bool:
        """True while a world is being read."""
        return self._task is not None

    @property
    def is_behind(self) -> bool:
        """True while another world than the present one is still shown."""
        return self.is_reading or self._changes.new_world_shape() is not None

    def follow(self, scene: bpy.types.Scene) -> WorldTask | None:
        """Makes the present world ready to be shown where another one is, a turn at a time; the task that has it once
        it is, whose world counts as shown from then on."""
        task, self._task = self._task, None
        shape = self._changes.new_world_shape()
        if task is None:
            self._task = self._read(scene, shape) if shape is not None else None
        elif not task.done:
            self._task = task
            if task.shape != shape:  # It has changed again.
                task.cancel()
        elif task.needs_blender:
            self._task = self._read(scene, task.shape, by_blender=True)
        elif task.error is None:
            self._take(task)
            return task
        elif not task.was_cancelled:
            self._refuse(task.shape, task.error)
        return None

    def _read(self, scene: bpy.types.Scene, shape: str, by_blender: bool = False) -> WorldTask | None:
        try:
            return WorldTask(scene, shape, self._before, by_blender)
        except Exception as error:
            self._refuse(shape, error)
            return None

    def _take(self, task: WorldTask) -> None:
        self._before = task
        self._changes.maps[task.world.map] = task.shape
        self._changes.note_world(task.world.map, task.world.color)

    def _refuse(self, shape: str, error: Exception) -> None:
        self._changes.refuse_world(shape, world_change.reason(error))

    def close(self) -> None:
        """Ends what is in the making, and lets go of what was read."""
        if self._task is not None:
            self._task.cancel()
        self._before = None
