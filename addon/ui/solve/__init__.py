"""Solving in the window: panels, operators, the scribble brush and their settings."""
