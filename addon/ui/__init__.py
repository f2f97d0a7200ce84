"""What the artist sees in Blender's window: panels, and operators that only call functions of the other rooms."""

from . import handlers, looks, looks_panel, mixer, overlay, preferences, rows, settings, start

MODULES = (preferences, settings, rows, looks, overlay, handlers, start, mixer, looks_panel)
"""Registered in this order, unregistered in reverse."""
