"""Cycles as the reference: settings without tricks, pixels as numpy. Needs `bpy`."""

import tempfile
from pathlib import Path

import bpy
import numpy as np


def prepare(scene, width, height):
    """Plain path tracing on the CPU at the given size; bounce limits and film filter stay the file's."""
    bpy.ops.preferences.addon_enable(module="cycles")
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.use_border = render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = True
    cycles.device = "CPU"
    cycles.use_denoising = cycles.use_adaptive_sampling = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.use_light_tree = True


def render(scene, samples, seed):
    """The scene-linear Combined image, (height, width, 3), top row first."""
    scene.cycles.samples, scene.cycles.seed = samples, seed
    settings = scene.render.image_settings
    settings.file_format, settings.color_depth, settings.color_mode = "OPEN_EXR", "32", "RGBA"
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = str(Path(folder) / "cycles.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        image.colorspace_settings.name = "Non-Color"
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        width, height = image.size
        bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[::-1, :, :3].copy()
