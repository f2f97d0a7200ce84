"""Panels in Blender's window, property groups, and operators that call functions of the other packages."""

from ..live import handlers
from . import (
    background,
    farm,
    looks,
    looks_panel,
    main_panel,
    mixer,
    overlay,
    preferences,
    render,
    render_pass,
    rows,
    settings,
    start,
    timers,
    verify,
)
from .shots import operators as shot_operators
from .shots import panel as shot_panel
from .shots import settings as shot_settings
from .solve import locks, regions, scribble_tool, target
from .solve import operators as solve_operators
from .solve import panel as solve_panel
from .solve import settings as solve_settings

MODULES = (
    *(timers, preferences, settings, shot_settings, solve_settings, rows, looks, overlay, handlers),
    *(start, main_panel, shot_operators, shot_panel, mixer, looks_panel, verify, background, farm),
    *(render_pass, render),
    *(regions, target, locks, scribble_tool, solve_operators, solve_panel),
)
"""Registered in this order, unregistered in reverse."""
