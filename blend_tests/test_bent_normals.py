"""Diffuse surfaces with bent normals reflect what they reflect in Cycles of the same version."""

import math

import pytest

from cards import Cards, differences, node
from helpers import add_light

pytestmark = pytest.mark.every_version

SPACES = ("OBJECT", "WORLD", "BLENDER_OBJECT", "BLENDER_WORLD")


def add_sun(scene, from_above, energy=3.0):
    """A sun along x, so many radians from straight above."""
    sun = add_light(scene, "SUN", energy=energy)
    sun.rotation_euler, sun.data.angle = (0.0, from_above, 0.0), 0.3


def bent(cards, name, kind, tilt, towards=1.0, space="OBJECT"):
    """A card of a closure whose normal is tilted along x; its material."""
    tree, output = cards.add(name)
    side = -1.0 if space.startswith("BLENDER") else 1.0
    normal = (towards * math.sin(tilt), 0.0, side * math.cos(tilt))
    color = (*(0.5 * value + 0.5 for value in normal), 1.0)
    turned = node(tree, "ShaderNodeNormalMap", {"Color": color}, space=space).outputs[0]
    shader = node(tree, kind, {"Normal": turned})
    if "Specular IOR Level" in shader.inputs:
        shader.inputs["Specular IOR Level"].default_value = 0.0
    tree.links.new(shader.outputs[0], output.inputs["Surface"])
    return cards.scene.objects[name].active_material


@pytest.mark.parametrize("corrects", [True, False])
def test_grazing_light_is_dimmed_as_in_cycles(scene, tmp_path, corrects):
    add_sun(scene, 1.1)
    cards = Cards(scene, columns=6)
    for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfPrincipled"):
        for tilt in (0.2, 0.5, 0.9):
            for towards in (1.0, -1.0):
                material = bent(cards, f"{kind} {tilt} {towards}", kind, tilt, towards)
                material.cycles.use_bump_map_correction = corrects
    means, warnings = cards.means(tmp_path, samples=512)
    assert differences(means, tolerance=0.03) == {}
    assert warnings == []


def test_all_spaces_of_normal_maps_are_known(scene, tmp_path):
    """Normals towards the camera, and away from it, where light shines on what lets it through."""
    add_sun(scene, 0.6)
    cards = Cards(scene)
    for kind in ("ShaderNodeBsdfDiffuse", "ShaderNodeBsdfTranslucent"):
        for space in SPACES:
            for tilt in (0.4, math.pi - 0.4):
                bent(cards, f"{kind} {space} {tilt:.1f}", kind, tilt, space=space)
    means, warnings = cards.means(tmp_path, samples=512)
    assert differences(means, tolerance=0.04) == {}
    assert warnings == []


def test_sheen_whose_normal_points_away_from_the_camera_is_seen_from_the_side(scene, tmp_path):
    add_sun(scene, 1.1)
    cards = Cards(scene)
    for tilt in (0.9, 1.7, 1.9):
        bent(cards, f"Sheen {tilt}", "ShaderNodeBsdfSheen", tilt)
    means, warnings = cards.means(tmp_path, samples=512)
    assert differences(means, tolerance=0.04) == {}
    assert warnings == []
