"""Culling of Simplify: objects that Cycles leaves out by where they are, as its `BlenderObjectCulling` does."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .camera import WatchedCamera

SWITCHES = ("use_camera_cull", "use_distance_cull")


def culling_settings(scene: bpy.types.Scene) -> list[Any]:
    """Switches and margins of a scene; empty where nothing is culled."""
    cycles = getattr(scene, "cycles", None)
    if cycles is None or not scene.render.use_simplify or not any(getattr(cycles, switch) for switch in SWITCHES):
        return []
    names = (*SWITCHES, "camera_cull_margin", "distance_cull_margin")
    return [getattr(cycles, name) for name in names]


class Culling:
    """Test of which objects are left out of a scene for a camera."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, camera: WatchedCamera):
        scene = depsgraph.scene
        self.by_camera = self.by_distance = False
        if not culling_settings(scene):
            return
        cycles, render = scene.cycles, scene.render
        self.camera = np.array(camera.matrix_world)
        self.margin, self.most_distance = cycles.camera_cull_margin, cycles.distance_cull_margin
        self.by_camera = cycles.use_camera_cull and camera.data.type != "PANO"
        self.by_distance = cycles.use_distance_cull and self.most_distance > 0.0
        projection = camera.calc_matrix_camera(
            depsgraph,
            x=render.resolution_x,
            y=render.resolution_y,
            scale_x=render.pixel_aspect_x,
            scale_y=render.pixel_aspect_y,
        )
        self.clip_from_world = np.array(projection @ camera.matrix_world.inverted_safe())

    def leaves_out(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        """True if an instance is in no picture. Of an object that both tests ask for, both have to say so."""
        if not (self.by_camera or self.by_distance):
            return False
        cycles, tests = instance.object.cycles, []
        if self.by_camera and cycles.use_camera_cull:
            tests.append(self._is_out_of_sight)
        if self.by_distance and cycles.use_distance_cull:
            tests.append(self._is_far)
        if not tests:
            return False
        box = np.array([(*corner, 1.0) for corner in instance.object.bound_box])
        corners = box @ np.array(instance.matrix_world).T
        return all(test(corners) for test in tests)

    def _is_out_of_sight(self, corners: np.ndarray) -> bool:
        """True if the box is behind the camera, or beside the picture by the margin: a share of its size."""
        clip = corners @ self.clip_from_world.T
        depth = 0.5 * (clip[:, 2] + clip[:, 3])
        if (depth < -self.margin).all():
            return True
        film = 0.5 + 0.5 * clip[:, :2] / clip[:, 3:]
        film[depth < 0.0] = 1.0 - film[depth < 0.0]
        return bool((film.min(axis=0) >= 1.0 + self.margin).any() or (film.max(axis=0) <= -self.margin).any())

    def _is_far(self, corners: np.ndarray) -> bool:
        """True if no part of the box is as near to the camera as the limit."""
        camera = self.camera[:3, 3]
        nearest = np.clip(camera, corners[:, :3].min(axis=0), corners[:, :3].max(axis=0))
        return bool(np.linalg.norm(camera - nearest) > self.most_distance)
