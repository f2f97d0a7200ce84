"""Worlds: reading, rendering by Cycles, and following changes."""
