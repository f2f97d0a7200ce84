"""The shading "Rendered" shows the picture in the camera's frame, within the render border as a render does."""

from types import SimpleNamespace

import gpu
import numpy as np
import pytest
from mathutils import Matrix, Vector

from addon.viewport import rendered, texture

pytestmark = pytest.mark.usefixtures("gpu_started")

WIDTH, HEIGHT = 64, 48
LEFT, BOTTOM = 20, 15
REGION = (120, 90)


def frame_of(seed):
    """A picture of noise."""
    image = np.ones((HEIGHT, WIDTH, 4), np.float32)
    image[..., :3] = np.random.default_rng(seed).uniform(0.1, 1.0, (HEIGHT, WIDTH, 3))
    return SimpleNamespace(serial=seed, scale=1, image=image)


@pytest.fixture
def shown(scene, monkeypatch):
    """Draws a pass of the camera into a region; pixels [height, width, 3], bottom row first, and the picture that it
    should be."""
    whole, frames = frame_of(1), {"Combined_Key": frame_of(2)}
    opened = SimpleNamespace(
        picture=whole,
        picture_of=lambda name: frames.get(name, whole),
        camera="Camera",
        is_working=False,
        is_tracing=False,
        recognises=lambda _camera: True,
        is_seen_beside=False,
    )
    monkeypatch.setattr(rendered.open_shots, "all_of", lambda _scene: [opened])
    place = rendered.Rectangle(LEFT, BOTTOM, LEFT + WIDTH, BOTTOM + HEIGHT)
    monkeypatch.setattr(rendered.camera_frame, "frame_of", lambda *_arguments: place)
    engine = SimpleNamespace(bind_display_space_shader=lambda _scene: None, unbind_display_space_shader=lambda: None)
    context = SimpleNamespace(
        scene=scene,
        region=SimpleNamespace(width=REGION[0], height=REGION[1]),
        space_data=SimpleNamespace(use_local_camera=False),
        region_data=None,
    )

    def draw(name="Combined", is_there=True):
        target = gpu.types.GPUTexture(REGION, format="RGBA32F")
        framebuffer = gpu.types.GPUFrameBuffer(color_slots=target)
        with framebuffer.bind(), gpu.matrix.push_pop(), gpu.matrix.push_pop_projection():
            framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0))
            gpu.matrix.load_matrix(Matrix.Identity(4))
            to_clip = Matrix.Diagonal((2.0 / REGION[0], 2.0 / REGION[1], 1.0, 1.0))
            gpu.matrix.load_projection_matrix(Matrix.Translation(Vector((-1.0, -1.0, 0.0))) @ to_clip)
            assert rendered.draw(engine, context, name) == is_there
            pixels = framebuffer.read_color(0, 0, *REGION, 4, 0, "FLOAT")
        return np.array(pixels.to_list(), np.float32)[..., :3], opened.picture_of(name).image[..., :3]

    draw.opened = opened
    yield draw
    texture.free()


@pytest.mark.parametrize(("name", "is_there"), [("Combined", True), ("Combined_Key", True), ("Combined_Gone", False)])
def test_the_picture_is_in_its_place(shown, name, is_there):
    pixels, image = shown(name, is_there)
    part = pixels[BOTTOM : BOTTOM + HEIGHT, LEFT : LEFT + WIDTH]
    assert np.allclose(part, image, atol=2e-3)
    part[:] = 0.0
    assert not pixels.any()


@pytest.mark.parametrize(("name", "says"), [("Combined", False), ("Combined_Key", False), ("world", True)])
def test_while_paths_are_traced_the_picture_says_that_it_stands_in_for_a_pass(shown, monkeypatch, name, says):
    written = []
    monkeypatch.setattr(rendered, "_write", lambda words, *_place: written.append(words))
    shown(name, is_there=not says)
    assert written == []
    shown.opened.is_tracing = True
    shown(name, is_there=not says)
    assert written == [rendered.TOO_EARLY] * says


def test_outside_of_the_render_border_nothing_is_drawn(scene, shown):
    render = scene.render
    render.use_border = True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.75, 0.5, 1.0
    pixels, image = shown()
    inside = slice(HEIGHT // 2, HEIGHT), slice(WIDTH // 4, 3 * WIDTH // 4)
    expected = np.zeros_like(image)
    expected[inside] = image[inside]
    assert np.allclose(pixels[BOTTOM : BOTTOM + HEIGHT, LEFT : LEFT + WIDTH], expected, atol=2e-3)
