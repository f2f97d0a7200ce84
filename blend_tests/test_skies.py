"""Sky Textures of materials show what those of Cycles show."""

import bpy
import pytest

from cards import Cards, differences, node

pytestmark = pytest.mark.every_version

KINDS = [item.identifier for item in bpy.types.ShaderNodeTexSky.bl_rna.properties["sky_type"].enum_items]


def shown(cards, name, kind, vector=None, **settings):
    """A card that emits a sky of a Cycles kind, a little of it."""
    tree, output = cards.add(name)
    inputs = {} if vector is None else {"Vector": vector(tree)}
    sky = node(tree, "ShaderNodeTexSky", inputs, sky_type=kind, **settings)
    if hasattr(sky, "sun_disc") and "sun_disc" not in settings:
        sky.sun_disc = False
    dim = node(tree, "ShaderNodeVectorMath", {0: sky.outputs["Color"], "Scale": 0.1}, operation="SCALE")
    cards.show(tree, output, dim.outputs["Vector"])
    return sky


def coordinates(output, scale=(1.0, 1.0, 1.0), turn=(0.0, 0.0, 0.0)):
    """Texture coordinates, scaled and turned."""

    def make(tree):
        source = tree.nodes.new("ShaderNodeTexCoord").outputs[output]
        return node(tree, "ShaderNodeMapping", {"Vector": source, "Scale": scale, "Rotation": turn}).outputs[0]

    return make


@pytest.mark.parametrize("kind", KINDS)
def test_a_sky_is_that_of_cycles(scene, tmp_path, kind):
    """By directions and by vectors of any length, of which only the height counts beside the bearing."""
    cards = Cards(scene, columns=4)
    shown(cards, "implied", kind)
    shown(cards, "short", kind, coordinates("Object", (0.6, 0.6, 0.6), (0.9, 0.0, 0.0)))
    shown(cards, "long", kind, coordinates("Object", (3.0, 3.0, 3.0), (0.7, 0.0, 0.4)))
    shown(cards, "towards the eye", kind, coordinates("Normal", turn=(1.2, 0.0, 0.8)))
    shown(cards, "mapped", kind, coordinates("Generated")).texture_mapping.rotation = (0.8, 0.3, 0.0)
    means, warnings = cards.means(tmp_path, samples=256)
    assert differences(means, tolerance=0.02) == {}
    assert warnings == []


def test_the_sun_of_a_sky_is_as_bright_as_in_cycles(scene, tmp_path):
    """A card that is filled by a part of the sky six degrees wide, with the sun in it."""
    kind = "NISHITA" if "NISHITA" in KINDS else "MULTIPLE_SCATTERING"
    cards = Cards(scene, columns=2)
    for name, size in (("sun", 0.05), ("large sun", 0.08)):
        vector = coordinates("Object", (0.1, 0.1, 1.0), (0.0, -1.0, 0.0))
        sky = shown(cards, name, kind, vector, sun_disc=True, sun_size=size, sun_intensity=0.001)
        sky.sun_elevation, sky.sun_rotation = 0.4, 0.5
    means, warnings = cards.means(tmp_path, samples=256)
    assert warnings == []
    for name, (ours, cycles) in means.items():
        assert abs(ours.sum() / cycles.sum() - 1.0) < 0.03, name
