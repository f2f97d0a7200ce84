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
    settings,
    start,
    verify,
)

MODULES = (
    *(preferences, settings, rows, looks, overlay, handlers),
    *(start, main_panel, mixer, looks_panel, verify, background, render),
)
"""Registered in this order, unregistered in reverse."""
