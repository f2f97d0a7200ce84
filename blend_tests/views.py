"""Settings of a scene's view, each a function that makes them, and what colours views without another Blender."""

import mmap
from pathlib import Path

import bpy
import pytest

from addon.core.fresh_memory import FreshMemory
from addon.export import write_view_table
from addon.export.color_table import color_table
from addon.viewport import view_table


class ColouredHere:
    """Stands in for the Blender in the background (`ViewWorker`): this one does what is asked for."""

    def __init__(self):
        self._job, self._pieces = None, []
        self.is_finished = False

    def ask(self, job):
        if job != self._job or self.is_finished:
            self._job, self.is_finished = job, False
            self._pieces = [self._write] if "file" in job else [self._coarse, self._fine]

    def drop(self):
        self._job, self._pieces = None, []

    def turn(self):
        self.is_finished = not self._pieces
        found = self._pieces[0]() if self._pieces else None
        del self._pieces[:1]  # What fails stays to be done.
        return found

    def _coarse(self):
        return color_table(bpy.context.scene, view_table.COARSE), FreshMemory(mmap.PAGESIZE)

    def _fine(self):
        return color_table(bpy.context.scene, view_table.FINE), FreshMemory(mmap.PAGESIZE)

    def _write(self):
        write_view_table(bpy.context.scene, Path(self._job["file"]), self._job["stamp"].encode("latin-1"))


def high_contrast(scene):
    look = "AgX - High Contrast" if bpy.app.version >= (4, 2, 0) else "High Contrast"
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", look


def curves(scene):
    view = scene.view_settings
    view.view_transform, view.use_curve_mapping, view.exposure = "AgX", True, 0.7
    view.curve_mapping.curves[3].points.new(0.4, 0.6)
    view.curve_mapping.curves[0].points.new(0.5, 0.45)
    view.curve_mapping.update()


def white_balance(scene):
    view = scene.view_settings
    if not hasattr(view, "use_white_balance"):
        pytest.skip("this Blender has no white balance in its view")
    view.view_transform, view.use_white_balance = "AgX", True
    view.white_balance_temperature, view.white_balance_tint = 4200.0, 25.0


def view(**settings):
    """Sets plain properties of the view."""

    def apply(scene):
        for key, value in settings.items():
            setattr(scene.view_settings, key, value)

    return apply


VIEWS = {
    "AgX": view(view_transform="AgX"),
    "AgX, exposure and gamma": view(view_transform="AgX", exposure=-1.3, gamma=1.4),
    "AgX, look": high_contrast,
    "AgX, curves": curves,
    "AgX, white balance": white_balance,
    "Filmic": view(view_transform="Filmic", exposure=2.0),
    "Filmic, look": view(view_transform="Filmic", look="Very High Contrast"),
    "Standard": view(view_transform="Standard"),
    "Standard, exposure and gamma": view(view_transform="Standard", exposure=0.8, gamma=0.7),
    "False Color": view(view_transform="False Color"),
    "False Color, exposure and gamma": view(view_transform="False Color", exposure=1.6, gamma=1.2),
    "Khronos": view(view_transform="Khronos PBR Neutral"),
}
