"""The relit picture inside Blender's own 3D view: reads the newest frame, never computes or waits."""
