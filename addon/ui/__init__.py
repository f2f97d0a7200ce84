"""What the artist sees in Blender's window: panels, and operators that only call functions of the other rooms."""

from . import (
    background,
    handlers,
    looks,
    looks_panel,
    main_panel,
    mixer,
    overlay,
    preferences,
    render,
    rows,
    scribble_tool,
    settings,
    solve_settings,
    start,
    verify,
)

MODULES = (
    *(preferences, settings, solve_settings, rows, looks, overlay, handlers),
    *(start, main_panel, mixer, looks_panel, verify, background, render, scribble_tool),
)
"""Registered in this order, unregistered in reverse."""
