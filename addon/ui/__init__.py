"""What the artist sees in Blender's window: panels, and operators that only call functions of the other rooms."""

from . import (
    background,
    handlers,
    locks,
    looks,
    looks_panel,
    main_panel,
    mixer,
    overlay,
    preferences,
    regions,
    render,
    render_pass,
    rows,
    scribble_tool,
    settings,
    solve_operators,
    solve_panel,
    solve_settings,
    solving,
    start,
    target,
    timers,
    verify,
)

MODULES = (
    *(timers, preferences, settings, solve_settings, rows, looks, overlay, handlers),
    *(start, main_panel, mixer, looks_panel, verify, background, render_pass, render),
    *(regions, target, locks, solving, scribble_tool, solve_operators, solve_panel),
)
"""Registered in this order, unregistered in reverse."""
