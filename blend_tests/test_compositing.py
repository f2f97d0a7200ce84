"""Set Up Compositing: the picture is the sum of its passes, each of which has an exposure and a tint."""

import bpy
import numpy as np
import pytest
from test_render_engine import passes_of, render, shot  # noqa: F401 -- a fixture

from addon.apply import compositor
from addon.ui import render as ui

pytestmark = pytest.mark.every_version


def composite(scene, tmp_path):
    """Passes of F12, and what the compositor makes of them."""
    passes = render(scene, tmp_path)
    return passes, passes_of(tmp_path / "f12.exr", composite=True)["Combined"]


def test_the_compositor_adds_up_the_lights(shot, tmp_path):  # noqa: F811
    shot.render.film_transparent = True
    assert bpy.ops.relume.set_up_compositing() == {"FINISHED"}
    passes, picture = composite(shot, tmp_path)
    np.testing.assert_allclose(picture, passes["Combined"], atol=1e-4)
    tree = shot.compositing_node_group if compositor.IS_GROUP else shot.node_tree
    (mix,) = [node for node in tree.nodes if node.bl_idname == "CompositorNodeGroup"]
    mix.inputs["Combined_Key Exposure"].default_value = 1.0
    mix.inputs["world Tint"].default_value = (0.0, 0.5, 1.0, 1.0)
    passes, picture = composite(shot, tmp_path)
    expected = passes["Combined"][..., :3] + passes["Combined_Key"] - passes["world"] * (1.0, 0.5, 0.0)
    np.testing.assert_allclose(picture[..., :3], expected, atol=1e-4)


def test_nodes_of_the_artist_stay_as_they_are(shot):  # noqa: F811
    tree = compositor._tree(shot)
    tree.nodes.clear()
    blur, output = tree.nodes.new("CompositorNodeBlur"), compositor._output(tree)
    link = tree.links.new(blur.outputs[0], output.inputs[0])
    bpy.ops.relume.set_up_compositing()
    assert output.inputs[0].links[0].from_node == blur == link.from_node
    frames = [node for node in tree.nodes if node.bl_idname == "NodeFrame"]
    assert [frame.label for frame in frames] == [compositor.FRAME]


def test_without_passes_of_lights_it_cannot_be_done(shot):  # noqa: F811
    shot.relume_render.light_passes = False
    assert not ui.RELUME_OT_set_up_compositing.poll(bpy.context)
