"""Relume: relights finished Blender shots with real materials and full global illumination."""

from . import _libraries as _libraries
from ._native import (
    Frame,
    Light,
    Live,
    LiveStatus,
    Relighter,
    RelumeError,
    Request,
    Scene,
    SceneBuilder,
    World,
    __version__,
    folder_in_use,
    run_command_line,
)
from .jobs import Job, bake, info, solve, start, train, validate

__all__ = [
    "Frame",
    "Job",
    "Light",
    "Live",
    "LiveStatus",
    "Relighter",
    "RelumeError",
    "Request",
    "Scene",
    "SceneBuilder",
    "World",
    "__version__",
    "bake",
    "folder_in_use",
    "info",
    "run_command_line",
    "solve",
    "start",
    "train",
    "validate",
]
