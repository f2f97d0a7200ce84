"""Blender's own display of a picture: its EXR, opened in an image editor on the screen."""

import math

import bpy
import numpy as np

BESIDE_BORDERS = 0.75
"""Where a picture begins in a pixel of the screen."""


def write_exr(path, pixels):
    """Writes scene-linear pixels, RGBA [height, width, 4], bottom row first, as Blender saves a render in 32 bits."""
    output = bpy.context.scene.render.image_settings
    before = output.file_format, output.color_depth
    output.file_format, output.color_depth = "OPEN_EXR", "32"
    image = bpy.data.images.new("picture", *pixels.shape[1::-1], alpha=True, float_buffer=True)
    image.pixels.foreach_set(np.ascontiguousarray(pixels, np.float32).ravel())
    image.save_render(str(path), scene=bpy.context.scene)
    bpy.data.images.remove(image)
    output.file_format, output.color_depth = before


def read_exr(path):
    """Scene-linear pixels of an EXR as Blender opens it, RGBA [height, width, 4], bottom row first."""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, -1)


def in_image_editor(driver, path, name=None):
    """Screen's pixels of an EXR in the scene's view, 0..1 [height, width, 3], bottom row first: in an image editor in
    the place of the 3D view, a pixel of the picture on each of the screen."""
    area, image = driver.view, bpy.data.images.load(str(path))
    image.use_view_as_render = True
    area.type = "IMAGE_EDITOR"
    space = area.spaces.active
    space.image = image
    space.show_region_header = space.show_region_toolbar = space.show_region_ui = False
    space.show_gizmo = space.overlay.show_overlays = False
    yield from _drawn(driver, area)
    region = next(region for region in area.regions if region.type == "WINDOW")
    width, height = image.size
    within = {"window": driver.window, "area": area, "region": region}
    with bpy.context.temp_override(**within):
        bpy.ops.image.view_zoom_ratio(ratio=1.0)
    yield from _drawn(driver, area)
    # A pixel of the screen shows what of the picture is at its lower left corner, before Blender 5 at its middle: best
    # near the border of two in neither.
    offset = [place - math.floor(place) - BESIDE_BORDERS for place in _corner(region, (width, height))]
    with bpy.context.temp_override(**within):
        bpy.ops.image.view_pan(offset=offset)
    yield from _drawn(driver, area)
    corner = _corner(region, (width, height))
    off = max(abs(place - math.floor(place) - BESIDE_BORDERS) for place in corner)
    driver.check(off < 0.01, f"the image editor shows pixels as they are: they begin at {corner}")
    left, bottom = region.x + math.ceil(corner[0]), region.y + math.ceil(corner[1])
    pixels = driver.photo(name)[::-1][bottom : bottom + height, left : left + width] / 255.0
    driver.check(pixels.shape[:2] == (height, width), "the image editor shows all of the picture")
    space.image = None
    area.type = "VIEW_3D"
    bpy.data.images.remove(image)
    yield from driver.drawn()
    return pixels


def _corner(region, size):
    """Where a picture's lower left corner is, in pixels of an image editor's region that shows it 1 to 1."""
    return [-share * pixels for share, pixels in zip(region.view2d.region_to_view(0, 0), size, strict=True)]


def _drawn(driver, area):
    """Waits until an image editor was drawn."""
    draws = []
    handler = bpy.types.SpaceImageEditor.draw_handler_add(lambda: draws.append(1), (), "WINDOW", "POST_PIXEL")
    area.tag_redraw()
    yield from driver.until(lambda: draws, "a redraw of the image editor")
    bpy.types.SpaceImageEditor.draw_handler_remove(handler, "WINDOW")
    yield from driver.wait(0.1)  # The drawing comes before the window is shown.
