"""Staleness of a bake: fingerprints of the scene, and what has changed since."""
