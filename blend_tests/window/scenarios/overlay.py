"""The picture in the camera's frame is, on the screen, what Blender itself shows of its EXR; exactly in its place."""

from types import SimpleNamespace

import bpy
import numpy as np
import relume
from artist import addon
from bpy_extras.view3d_utils import location_3d_to_region_2d
from display import in_image_editor, read_exr, write_exr
from mathutils import Vector

NEEDS = ["demo.blend"]
EVERY_TIME = True
ON_VULKAN = True
SIZE = (960, 540)


class Picture:
    """Stands in for `relume.Live`: shows the pictures that it is given."""

    given = None

    def __init__(self, *_arguments, **_options):
        pass

    def __getattr__(self, name):
        return lambda *_arguments, **_options: 0

    def status(self):
        return relume.LiveStatus(state="ready")

    def frame(self, newer_than=0):
        return Picture.given if Picture.given and Picture.given.serial > newer_than else None


def frame(serial, seed=1, scale=1):
    """Colours of all hues from 2^-8 to 2^4, opaque; as the native module gives it, bottom row first."""
    image = np.ones((SIZE[1] // scale, SIZE[0] // scale, 4), np.float32)
    image[..., :3] = np.exp2(np.random.default_rng(seed).uniform(-8.0, 4.0, (*image.shape[:2], 3)))
    return SimpleNamespace(serial=serial, request=serial, scale=scale, image=image, summary="{}")


def dark(serial):
    """Colours from 0 to 0.02."""
    picture = frame(serial)
    picture.image[..., :3] = np.random.default_rng(serial).uniform(0.0, 0.02, picture.image[..., :3].shape)
    return picture


def ramp(serial):
    """From 2^-8 to 2^4, of slowly changing hues: Blender puts a ten-thousandth of each pixel's neighbour into it, which
    shows where a channel of 0 is beside one of 1, as 4 of 255. With high contrast many are 0."""
    picture = frame(serial)
    stops, hue = np.meshgrid(np.linspace(-8.0, 4.0, SIZE[0]), np.linspace(0.0, 3.0, SIZE[1]))
    for channel in range(3):
        picture.image[..., channel] = np.exp2(stops + np.cos(hue + 2.1 * channel))
    return picture


def rectangle(driver, window=None):
    """The camera's frame in a window, in pixels of the screen: left, top, right, bottom, the top row being 0."""
    window = window or driver.window
    region, data = driver.region(window=window), driver.view_of(window).spaces.active.region_3d
    scene = bpy.context.scene
    found = addon("viewport.camera_frame").frame_of(scene, scene.camera, region, data)
    found = found.snapped(SIZE) or found
    left, right = (round(window.x + region.x + x) for x in (found.left, found.right))
    screen_top = driver.window.y + driver.window.height
    top, bottom = (round(screen_top - window.y - region.y - y) for y in (found.top, found.bottom))
    return left, top, right, bottom


def shown(driver, name=None):
    """Screen's pixels in the camera's frame, 0..1, bottom row first."""
    yield from driver.drawn()
    view_table = addon("viewport.view_table")
    yield from driver.until(lambda: view_table.is_complete(bpy.context.scene), "the view's table", 300)
    yield from driver.drawn()
    left, top, right, bottom = rectangle(driver)
    return driver.photo(name)[top:bottom, left:right][::-1] / 255.0


def displayed(driver, picture, name=None):
    """Blender's pixels of a frame's EXR, 0..1, bottom row first."""
    path = driver.scratch / "frame.exr"
    write_exr(path, picture.image)
    read = read_exr(path)
    driver.check(np.allclose(read, picture.image, rtol=1e-3, atol=1e-4), "the EXR holds the frame")
    return (yield from in_image_editor(driver, path, name))


def compare(driver, name, found, expected):
    """The goal of the overlay: at most 1 of 255 on average, 3 at the 99th percentile."""
    driver.check(found.shape == expected.shape, f"{name}: the frame has {expected.shape} pixels; it has {found.shape}")
    error = np.abs(np.round(found * 255) - np.round(expected * 255))
    driver.record(f"{name}: mean error", error.mean(), "of 255", 1)
    driver.record(f"{name}: 99th percentile of the error", np.percentile(error, 99), "of 255", 3)
    good = error.mean() <= 1.0 and np.percentile(error, 99) <= 3.0
    driver.check(good, f"{name}: as Blender displays it; mean {error.mean():.2f}, p99 {np.percentile(error, 99):.1f}")


def bare_camera_view(driver):
    """Nothing but the view, one pixel of the camera on one of the screen."""
    space = driver.view.spaces.active
    space.show_region_ui = space.show_region_toolbar = space.show_region_header = False
    space.show_gizmo = space.overlay.show_overlays = False
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.dither_intensity = 0.0
    yield from driver.look_through_camera()
    with driver.within():
        bpy.ops.view3d.zoom_camera_1_to_1()
    yield from driver.drawn()


def check_view(driver, name, view):
    """The newest picture, in a view, is what Blender shows of its EXR in that view."""
    file = name.replace(",", "").replace(" ", "-")
    with driver.step(name):
        set_view(view)
        pixels = yield from shown(driver, file)
    expected = yield from displayed(driver, Picture.given, f"{file}-exr")
    compare(driver, name, pixels, expected)


def check_working_spaces(driver):
    """Checks views in a file that has another scene-linear space than Linear Rec.709."""
    for space, views in {"ACEScg": SOME_VIEWS, "Linear Rec.709": {}}.items():
        bpy.ops.wm.set_working_color_space(working_space=space, convert_colors=False)
        driver.check(bpy.data.colorspace.working_space == space, f"the file is in {space}")
        for name, view in views.items():
            yield from check_view(driver, f"{space}, {name}", view)


VIEWS = {
    "AgX": {"view_transform": "AgX"},
    "AgX brighter": {"view_transform": "AgX", "exposure": 1.5, "gamma": 1.2},
    "Filmic": {"view_transform": "Filmic"},
    "Filmic high contrast": {"view_transform": "Filmic", "look": "High Contrast"},
    "Standard": {"view_transform": "Standard"},
    "Standard darker": {"view_transform": "Standard", "exposure": -1.0},
    "AgX curves": {"view_transform": "AgX", "exposure": 0.7, "curves": {3: (0.4, 0.6), 0: (0.5, 0.45)}},
    "Filmic curves": {"view_transform": "Filmic", "exposure": 0.5, "curves": {3: (0.6, 0.45), 2: (0.4, 0.55)}},
    "Standard curves": {"view_transform": "Standard", "curves": {1: (0.3, 0.5)}},
}
"""`curves`: a point for each of some of the curves red, green, blue and all of them together."""
HIGH_CONTRAST = {"view_transform": "AgX", "look": "AgX - High Contrast", "exposure": -0.8}
SOME_VIEWS = {"Standard darker": VIEWS["Standard darker"], "AgX high contrast": HIGH_CONTRAST}
"""In another working space."""


def set_view(settings):
    """Sets the scene's view; what is not named is neutral."""
    view = bpy.context.scene.view_settings
    view.view_transform = settings["view_transform"]
    plain = {"look": "None", "exposure": 0.0, "gamma": 1.0} | settings
    curves = plain.pop("curves", {})
    for key, value in plain.items():
        setattr(view, key, value)
    view.use_curve_mapping = bool(curves)
    for number, curve in enumerate(view.curve_mapping.curves if curves else ()):
        for point in list(curve.points)[1:-1]:
            curve.points.remove(point)
        if number in curves:
            curve.points.new(*curves[number])
    view.curve_mapping.update()


def flat(serial, color=(1.0, 0.0, 1.0)):
    """A picture of one colour that Blender's views do not have."""
    picture = frame(serial)
    picture.image[..., :3] = color
    return picture


def box_of(pixels):
    """Left, top, right, bottom of the magenta pixels of the screen; None if there are none."""
    there = (pixels[..., 0] > 240) & (pixels[..., 1] < 16) & (pixels[..., 2] > 240)
    if not there.any():
        return None
    columns, rows = np.flatnonzero(there.any(axis=0)), np.flatnonzero(there.any(axis=1))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def camera_settings(**settings):
    """Sets properties of the camera."""
    for key, value in settings.items():
        setattr(bpy.context.scene.camera.data, key, value)


def render_settings(**settings):
    """Sets properties of the render."""
    for key, value in settings.items():
        setattr(bpy.context.scene.render, key, value)


PLACES = [
    ("fits", {}, {}, {"view_camera_zoom": 0.0}),
    ("zoomed out", {}, {}, {"view_camera_zoom": -14.5}),
    ("panned", {}, {}, {"view_camera_offset": (0.11, -0.07)}),
    ("lens shift", {"shift_x": 0.15, "shift_y": -0.1}, {}, {}),
    ("half resolution", {}, {"resolution_percentage": 50}, {}),
    ("wide pixels", {}, {"pixel_aspect_x": 2.0}, {}),
    ("portrait", {"sensor_fit": "VERTICAL"}, {"resolution_x": 400}, {}),
    ("orthographic", {"type": "ORTHO", "ortho_scale": 3.0}, {}, {}),
    ("border", {}, {"use_border": True, "border_min_x": 0.25, "border_max_y": 0.6}, {}),
]


def check_places(driver):
    """The picture's edges on the screen are those of the camera's frame, to the pixel."""
    for name, camera, render, view in PLACES:
        camera_settings(**camera)
        render_settings(**render)
        for key, value in view.items():
            setattr(driver.view.spaces.active.region_3d, key, value)
        with driver.step(name):
            yield from driver.drawn()
            found = box_of(driver.photo())
            left, top, right, bottom = rectangle(driver)
            if name == "border":
                left, top = left + 0.25 * (right - left), bottom - 0.6 * (bottom - top)
            off = np.abs(np.subtract(found, (left, top, right, bottom))).max() if found else np.inf
            driver.check(off <= 1.0, f"{name}: in the frame {left, top, right, bottom}; it is in {found}")


def check_lights(driver):
    """A selected light is drawn over the picture."""
    scene, space = bpy.context.scene, driver.view.spaces.active
    render_settings(use_border=False)
    camera_settings(type="PERSP", sensor_fit="AUTO", shift_x=0.0, shift_y=0.0)
    render_settings(resolution_x=SIZE[0], resolution_percentage=100, pixel_aspect_x=1.0)
    light = next(obj for obj in scene.objects if obj.type == "LIGHT")
    light.location = scene.camera.matrix_world @ Vector((0.1, 0.05, -4.0))
    with driver.step("lights over the picture"):
        yield from driver.drawn()
        without = driver.photo()
        space.overlay.show_overlays = True
        yield from driver.drawn()
        pixels = driver.photo("lights")
        x, y = location_3d_to_region_2d(driver.region(), space.region_3d, light.matrix_world.translation)
        column = round(driver.region().x + x)
        row = round(driver.window.height - driver.region().y - y)
        near = (slice(row - 9, row + 10), slice(column - 9, column + 10))
        driver.check(np.any(pixels[near] != without[near]), "a ring is drawn where the light is")


def check_many_views(driver):
    """Four regions of one view and a second window show the picture, and closing it does no harm."""
    with driver.step("four regions"):
        with driver.within():
            bpy.ops.screen.region_quadview()
        yield from driver.drawn()
        driver.check(box_of(driver.photo("four-regions")) is not None, "the picture is in the camera's region")
        with driver.within():
            bpy.ops.screen.region_quadview()
        yield from driver.drawn()
    with driver.step("two windows"):
        bpy.ops.wm.window_new()
        second = bpy.context.window_manager.windows[-1]
        space = driver.view_of(second).spaces.active
        space.region_3d.view_perspective, space.overlay.show_overlays, space.show_gizmo = "CAMERA", False, False
        yield from driver.drawn()
        yield from driver.wait(1)
        found, expected = box_of(driver.photo("two-windows")), rectangle(driver, second)
        is_there = found is not None and all(abs(a - b) <= 1 for a, b in zip(found, expected, strict=True))
        driver.check(is_there, f"the picture is in the second window, which covers the first: {found}, not {expected}")
        Picture.given = flat(40, color=(0.0, 0.0, 0.0))
        addon("live.scheduler").scheduler.wake()
        yield from driver.until(lambda: box_of(driver.photo()) is None, "the black picture in the second window")
        Picture.given = flat(41)
        addon("live.scheduler").scheduler.wake()
        yield from driver.until(lambda: box_of(driver.photo()) == found, "the picture in the second window again")
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
            bpy.ops.wm.window_close()
        yield from driver.look_through_camera()
        driver.check(box_of(driver.photo()) is not None, "the first window still shows the picture")


def play(driver):
    """See the first line of this file."""
    yield from driver.open("demo.blend")
    shot = addon("engine.shot.shot")
    shot.native = lambda: SimpleNamespace(**vars(relume) | {"Live": Picture})
    Picture.given = frame(1)
    yield from bare_camera_view(driver)
    found = shot.Shot.open(bpy.context.scene)
    found.poll()
    found.camera = bpy.context.scene.camera.name
    settings = bpy.context.scene.relume_view
    for name, view in VIEWS.items():
        yield from check_view(driver, name, view)
    for name, view, picture in (
        ("dark, AgX", VIEWS["AgX"], dark(2)),
        ("dark, Standard", VIEWS["Standard"], dark(3)),
        ("False Color", {"view_transform": "False Color"}, ramp(4)),
        ("AgX high contrast", HIGH_CONTRAST, ramp(5)),
    ):
        Picture.given = picture
        yield from driver.until(found.poll, "another picture")
        yield from check_view(driver, name, view)
    if bpy.app.version >= (5, 0, 0):  # Files had no scene-linear space of their own before.
        yield from check_working_spaces(driver)
    set_view(VIEWS["Standard"])
    Picture.given = frame(6)
    yield from driver.until(found.poll, "the picture again")
    expected = yield from displayed(driver, Picture.given)
    with driver.step("wipe"):
        settings.wipe, settings.wipe_position = True, 0.25
        pixels = yield from shown(driver, "wipe")
        compare(driver, "wipe", pixels[:, :200], expected[:, :200])
        settings.shown = False
        without = yield from shown(driver)
        driver.check(np.array_equal(pixels[:, 300:], without[:, 300:]), "right of the wipe is the view itself")
        settings.shown = True
    with driver.step("drag the wipe"):
        driver.view.spaces.active.show_gizmo = True
        left, top, right, bottom = rectangle(driver)
        height = driver.window.height - (top + bottom) // 2
        yield from driver.move_mouse(left + 240, height)
        yield from driver.wait(0.2)
        yield from driver._event("LEFTMOUSE", "PRESS")
        yield from driver.drag((left + 240, height), (left + 720, height))
        yield from driver._event("LEFTMOUSE", "RELEASE")
        driver.check(abs(settings.wipe_position - 0.75) < 0.02, f"the line follows the mouse; {settings.wipe_position}")
        driver.view.spaces.active.show_gizmo = settings.wipe = False
    with driver.step("opacity"):
        settings.opacity = 0.4
        pixels = yield from shown(driver, "opacity")
        compare(driver, "opacity", pixels, (0.4 * expected**2.2 + 0.6 * without**2.2) ** (1 / 2.2))
        settings.opacity = 1.0
    pictures = [frame(serial, seed=serial, scale=1 + serial % 2) for serial in range(20, 30)]
    with driver.step("new pictures"):
        for Picture.given in pictures:
            yield from driver.until(found.poll, "a new picture")
            yield from driver.drawn()
    Picture.given = flat(30)
    yield from driver.until(found.poll, "a flat picture")
    set_view(VIEWS["Standard"])
    yield from check_places(driver)
    yield from check_lights(driver)
    yield from check_many_views(driver)
