"""Settings of a scene's view, each a function that makes them, and what colours views without another Blender."""

from pathlib import Path

import bpy
import pytest

from addon.export import write_view_table
from addon.export.color_table import color_table


class ColouredHere:
    """Stands in for the Blender in the background (`ViewWorker`): this one does what is asked for, a turn later."""

    def __init__(self):
        self._job, self._is_begun = None, False

    def ask(self, job):
        if job != self._job:
            self._job, self._is_begun = job, False

    def drop(self):
        self._job = None

    def turn(self):
        if not self._is_begun:
            self._is_begun = True
            return None
        job, table = self._job, None
        if "file" in job:
            write_view_table(bpy.context.scene, Path(job["file"]), job["stamp"].encode("latin-1"))
        else:
            table = color_table(bpy.context.scene)
        self.drop()
        return table


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
