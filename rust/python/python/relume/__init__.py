"""Relume: relights finished Blender shots with real materials and full global illumination."""

from . import _libraries as _libraries
from ._native import (
    Board,
    DataPasses,
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
    matte_hash,
    run_command_line,
)
from .jobs import Job, bake, info, solve, start, train, validate

__all__ = [
    "Board",
    "DataPasses",
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
    "matte_hash",
    "run_command_line",
    "solve",
    "start",
    "train",
    "validate",
]
