"""Writes into the artist's scene: all of it or nothing, and only when told to."""
