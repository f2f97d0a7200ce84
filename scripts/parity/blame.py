"""Which materials the large differences lie on. Needs `bpy`."""

import bpy
import numpy as np

from compare import BLOCK


def worst_materials(scene, difference, count=3):
    """Names of the materials with the largest mean block difference, with that difference and their share of the
    picture."""
    by_material = {}
    blocks_high, blocks_wide = difference.shape[:2]
    for row in range(blocks_high):
        for column in range(blocks_wide):
            name = _material_at(scene, (column + 0.5) * BLOCK, (row + 0.5) * BLOCK)
            by_material.setdefault(name, []).append(float(difference[row, column].mean()))
    total = blocks_high * blocks_wide
    rows = sorted(by_material.items(), key=lambda item: -sum(item[1]))
    return [f"{name} {np.mean(values):.1%} on {len(values) / total:.0%}" for name, values in rows[:count]]


def _material_at(scene, x, y):
    """Name of the first material seen at a pixel (from the top left)."""
    camera, render = scene.camera, scene.render
    top_right, _, bottom_left, top_left = (
        camera.matrix_world @ corner for corner in camera.data.view_frame(scene=scene)
    )
    target = top_left.copy()
    target += (top_right - top_left) * (x / render.resolution_x)
    target += (bottom_left - top_left) * (y / render.resolution_y)
    origin = camera.matrix_world.translation
    depsgraph = bpy.context.evaluated_depsgraph_get()
    hit, _, _, face, obj, _ = scene.ray_cast(depsgraph, origin, (target - origin).normalized())
    if not hit:
        return "(world)"
    slots = obj.material_slots
    index = obj.data.polygons[face].material_index if face < len(obj.data.polygons) else 0
    material = slots[min(index, len(slots) - 1)].material if slots else None
    return material.name if material else "(no material)"
