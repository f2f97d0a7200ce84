"""Which materials the large differences lie on. Needs `bpy`."""

import bpy
import numpy as np

from compare import BLOCK, block_difference


def worst_materials(scene, gathers, renders, count=3):
    """Where two gathers and two Cycles renders differ by more than their noise: names of materials, with their mean
    block difference, the part of it that noise explains, and their share of the picture."""
    difference = block_difference(np.mean(gathers, axis=0), np.mean(renders, axis=0)).mean(axis=-1)
    # A mean of two has half the noise that shows between the two.
    noise = 0.5 * np.hypot(block_difference(*gathers), block_difference(*renders)).mean(axis=-1)
    by_material = {}
    for (row, column), value in np.ndenumerate(difference):
        name = _material_at(scene, (column + 0.5) * BLOCK, (row + 0.5) * BLOCK)
        by_material.setdefault(name, []).append((value, noise[row, column]))
    rows = [(name, *np.mean(pairs, axis=0), len(pairs) / difference.size) for name, pairs in by_material.items()]
    rows.sort(key=lambda row: (row[2] - row[1]) * row[3])
    return [f"{name} {value:.1%} (noise {random:.1%}) on {share:.0%}" for name, value, random, share in rows[:count]]


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
