"""Solving: its jobs, paths and masks."""
