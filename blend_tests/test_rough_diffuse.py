"""Rough diffuse surfaces: each version dims in its own way what they scatter more than once."""

import bpy
import pytest

from cards import Cards, differences, node
from helpers import add_world

pytestmark = pytest.mark.every_version

COLORS = {"grey": (0.5, 0.5, 0.5, 1.0), "coloured": (0.9, 0.5, 0.1, 1.0)}


def test_rough_diffuse_surfaces_are_as_bright_as_in_cycles(scene, tmp_path):
    cards = Cards(scene, columns=2)
    for name, color in COLORS.items():
        for roughness in (0.3, 1.0):
            tree, output = cards.add(f"{name} {roughness}")
            shader = node(tree, "ShaderNodeBsdfDiffuse", {"Color": color, "Roughness": roughness})
            cards.show(tree, output, shader.outputs[0])
            if bpy.app.version >= (4, 3, 0):
                tree, output = cards.add(f"{name} principled {roughness}")
                inputs = {"Base Color": color, "Diffuse Roughness": roughness, "Specular IOR Level": 0.0}
                cards.show(tree, output, node(tree, "ShaderNodeBsdfPrincipled", inputs).outputs[0])
    add_world(scene, (1.0, 1.0, 1.0), 1.0)
    means, warnings = cards.means(tmp_path, samples=256)
    assert warnings == []
    assert differences(means, 0.008) == {}
