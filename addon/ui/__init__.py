"""What the artist sees in Blender's window: panels, and operators that only call functions of the other rooms."""

from . import handlers, preferences, settings, start

MODULES = (preferences, settings, handlers, start)
"""Registered in this order, unregistered in reverse."""
