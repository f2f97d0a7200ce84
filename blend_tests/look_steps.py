"""Steps that tests of looks share."""

import numpy as np

from addon.core.rows import GROUP
from addon.live import rows
from helpers import row


def dial(scene):
    """A state worth keeping."""
    key = row(scene, "Key")
    key.exposure, key.color, key.use_kelvin, key.kelvin = 1.5, (1.0, 0.5, 0.25), True, 3000.0
    row(scene, "Rig", GROUP).multiplier = 0.5
    row(scene, "Fill").solo = True


def values(scene):
    """All rows as plain data."""
    return {(found.kind, found.name): found.values() for found in rows.present_rows(scene)}


def scene_state(scene):
    """All that a look may write to lights."""
    return {
        obj.name: (
            obj.data.type,
            obj.data.energy,
            tuple(obj.data.color),
            np.round(np.array(obj.matrix_world), 5).tolist(),
            getattr(obj.data, "size", None),
            getattr(obj.data, "shape", None),
            obj.hide_render,
        )
        for obj in scene.objects
        if obj.type == "LIGHT"
    }
