"""Other Blender processes."""
