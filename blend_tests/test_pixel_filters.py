"""Pixel filters blur an edge as in Cycles."""

import numpy as np
import pytest
import relume

from addon.engine.reading.scene import load_scene
from addon.export import trace_settings
from helpers import add_material, add_quad, render_cycles

pytestmark = pytest.mark.oldest_and_newest


@pytest.mark.parametrize(
    ("kind", "width"), [("BOX", 4.0), ("GAUSSIAN", 1.5), ("GAUSSIAN", 6.0), ("BLACKMAN_HARRIS", 4.0)]
)
def test_an_edge_is_blurred_as_in_cycles(scene, tmp_path, kind, width):
    material, tree, output = add_material("Light")
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], output.inputs["Surface"])
    quad = add_quad(scene, size=20.0, material=material)
    quad.location.x = 10.0 + 0.3 / 16  # The edge is a third of a pixel beside a pixel's border.
    camera, render = scene.camera, scene.render
    camera.data.type, camera.data.ortho_scale = "ORTHO", 1.0
    camera.location, camera.rotation_euler = (0.0, 0.0, 5.0), (0.0, 0.0, 0.0)
    render.resolution_x = render.resolution_y = 16
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = kind, width
    samples = 1024
    exported = load_scene(scene)
    assert exported.warnings == []
    settings = trace_settings(scene, lambda _: None) | {"samples": samples}
    relume.bake(exported, tmp_path / "bake", settings).wait()
    ours = relume.Relighter(tmp_path / "bake").relight("[]", denoise=False)["combined"][..., 0].mean(axis=0)
    cycles = render_cycles(scene, samples=samples)[..., 0].mean(axis=0)
    assert np.ptp(cycles) > 0.7
    # A mean of 16 x 1024 samples, some of which are stratified.
    np.testing.assert_allclose(ours, cycles, atol=3 * 0.5 / np.sqrt(16 * samples))
